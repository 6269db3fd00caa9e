//! Reads, decodes and assembles a scene's files. Decoding is pure.

use super::cache::{PhotographCache, PhotographDigests};
use super::panorama::decode_panorama;
use super::sketch;
use super::smudges::{SmudgeMap, decode_map};
use super::window::Sight;
use super::{AssembleError, Decoded, DecodedSide, SceneFacts, assemble_decoded, decode_mesh};
use crate::formats::{NamedBytes, PanoramaFiles, PhotographFiles, SceneError};
use crate::trace::Scene;
use glasshouse_line::{RootError, Roots, SMUDGES_MAP, SceneLine, Side, card_key};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A scene that cannot be made from its files: a reason for quarantine.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    #[error(transparent)]
    Root(#[from] RootError),
    #[error("cannot read {}: {source}; check the path and the roots (--root NAME=DIR)", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Decode(#[from] SceneError),
    #[error(transparent)]
    Assemble(#[from] AssembleError),
}

/// The bytes of a scene's files.
pub struct SceneFiles {
    /// Side seen through the pane.
    pub front: SideFiles,
    /// Side reflected in the pane.
    pub back: SideFiles,
    /// Pictures of the cards of the front and of the back.
    pub cards: [Vec<NamedBytes>; 2],
    /// Map of the pane's smudges, if the line has one.
    pub smudges: Option<NamedBytes>,
}

impl SceneFiles {
    /// Makes the files of a scene without cards and without a map of smudges.
    pub fn new(front: SideFiles, back: SideFiles) -> Self {
        Self { front, back, cards: Default::default(), smudges: None }
    }
}

/// The bytes of the files of one side's surface.
pub enum SideFiles {
    Photograph(PhotographFiles),
    Panorama(PanoramaFiles),
    Mesh(NamedBytes),
}

/// A scene's two sides, decoded, and the digests of their files.
#[derive(Clone)]
pub struct DecodedScene {
    /// Side seen through the pane.
    pub front: DecodedSide,
    /// Side reflected in the pane.
    pub back: DecodedSide,
    /// Map of the pane's smudges, if the line has one.
    pub smudges: Option<Arc<SmudgeMap>>,
    /// Digests of the scene's files.
    pub inputs: InputDigests,
}

/// BLAKE3 digests (hex) of a scene's input files, by field of the scene line (`front.color`, ...).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct InputDigests(pub BTreeMap<String, String>);

/// A scene ready to trace, with its facts and the digests of its files.
pub struct LoadedScene {
    pub scene: Scene,
    /// Facts for partials and `tuple.json`.
    pub facts: SceneFacts,
    /// Digests of the scene's files.
    pub inputs: InputDigests,
}

impl LoadedScene {
    /// Adopts the line's seed, sample count and layers. The rest of the line must be unchanged.
    pub(crate) fn resample(&mut self, line: &SceneLine) {
        let scene = &mut self.scene;
        (scene.seed, scene.spp) = (line.seed, line.film.spp);
        scene.layers = line.film.layers.asked();
        scene.labels = line.film.layers.labels();
        self.facts.state_orders(scene);
    }
}

/// Reads all of a scene's local files, at the paths that [`Roots::resolve`] returns.
pub fn read_files(line: &SceneLine, roots: &Roots, base: &Path) -> Result<SceneFiles, LoadError> {
    read_files_by(line, roots, base, &crate::input_file::read)
}

/// Reads a scene's files from any storage: `read` receives the line's paths after [`Roots::resolve`].
pub fn read_files_by(
    line: &SceneLine,
    roots: &Roots,
    base: &Path,
    read: &dyn Fn(&Path) -> std::io::Result<Vec<u8>>,
) -> Result<SceneFiles, LoadError> {
    let named = |text: &str| -> Result<NamedBytes, LoadError> {
        let path = roots.resolve(base, text)?;
        match read(&path) {
            Ok(bytes) => Ok(NamedBytes { path, bytes }),
            Err(source) => Err(LoadError::Read { path, source }),
        }
    };
    let side = |side: &Side| -> Result<SideFiles, LoadError> {
        Ok(match side {
            Side::Photograph(p) => {
                let color = named(&p.color)?;
                let depth = match &p.sketch {
                    Some(sketch) => sketch::depth_file(p, sketch, &color)?,
                    None => named(&p.depth)?,
                };
                let mask = p.mask.as_deref().map(named).transpose()?;
                SideFiles::Photograph(PhotographFiles { color, depth, mask })
            }
            Side::Panorama(p) => SideFiles::Panorama(PanoramaFiles {
                panorama: named(&p.panorama)?,
                depth: p.depth.as_deref().map(named).transpose()?,
            }),
            Side::Mesh(p) => SideFiles::Mesh(named(&p.mesh)?),
        })
    };
    let cards = |side: &Side| -> Result<Vec<NamedBytes>, LoadError> {
        side.cards().iter().map(|card| named(&card.color)).collect()
    };
    Ok(SceneFiles {
        front: side(&line.front)?,
        back: side(&line.back)?,
        cards: [cards(&line.front)?, cards(&line.back)?],
        smudges: match line.glass.smudges.as_ref().and_then(|smudges| smudges.map.as_ref()) {
            None => None,
            Some(map) => Some(named(map)?),
        },
    })
}

/// Decodes the files and assembles the scene.
pub fn load(line: &SceneLine, files: &SceneFiles) -> Result<LoadedScene, LoadError> {
    load_with(line, files, &PhotographCache::new(0))
}

/// Like [`load`], with photographs from a cache. The scene has the same bits.
pub fn load_with(
    line: &SceneLine,
    files: &SceneFiles,
    cache: &PhotographCache,
) -> Result<LoadedScene, LoadError> {
    assemble_loaded(line, decode_with(line, files, &SceneDigests::of(files), cache)?)
}

/// Assembles a decoded scene.
pub(super) fn assemble_loaded(
    line: &SceneLine,
    decoded: DecodedScene,
) -> Result<LoadedScene, LoadError> {
    let inputs = decoded.inputs.clone();
    let (scene, facts) = assemble_decoded(line, decoded)?;
    Ok(LoadedScene { scene, facts, inputs })
}

/// Decodes the files: the first half of [`load`], for several scenes of the same photographs. Decodes only the part of
/// a panorama that is visible in this line.
pub fn decode(line: &SceneLine, files: &SceneFiles) -> Result<DecodedScene, LoadError> {
    decode_with(line, files, &SceneDigests::of(files), &PhotographCache::new(0))
}

/// Like [`decode`], with photographs from a cache. `digests` are those of the files.
pub(super) fn decode_with(
    line: &SceneLine,
    files: &SceneFiles,
    digests: &SceneDigests,
    cache: &PhotographCache,
) -> Result<DecodedScene, LoadError> {
    let side =
        |index: usize, side: &Side, files, sight: &dyn Fn() -> Sight, of_cards: &[NamedBytes]| {
            let side = side.seen_by(&line.camera);
            let digests = &digests.sides[index];
            let cards = side.cards().iter().zip(of_cards).zip(&digests.cards);
            Ok::<_, SceneError>(DecodedSide {
                surface: decode_side(&side, files, digests, cache, sight)?,
                cards: cards
                    .map(|((card, file), digest)| cache.card(card, file, *digest))
                    .collect::<Result<_, _>>()?,
            })
        };
    let [of_front, of_back] = &files.cards;
    Ok(DecodedScene {
        front: side(0, &line.front, &files.front, &|| Sight::front(line), of_front)?,
        back: side(1, &line.back, &files.back, &|| Sight::back(line), of_back)?,
        smudges: files.smudges.as_ref().map(decode_map).transpose()?,
        inputs: digests.inputs(),
    })
}

/// Decodes one side. Calls `sight` only for a panorama, because a line uses only a part of a panorama.
fn decode_side(
    side: &Side,
    files: &SideFiles,
    digests: &SideDigests,
    cache: &PhotographCache,
    sight: impl Fn() -> Sight,
) -> Result<Decoded, SceneError> {
    Ok(match (side, files) {
        (Side::Photograph(line), SideFiles::Photograph(files)) => {
            cache.photograph(line, files, digests.of_photograph())?.into()
        }
        (Side::Panorama(line), SideFiles::Panorama(files)) => {
            decode_panorama(line, files, &sight())?.into()
        }
        (Side::Mesh(line), SideFiles::Mesh(file)) => decode_mesh(line, file)?.into(),
        _ => unreachable!("the files were read for this line"),
    })
}

/// Digests of a scene's files.
pub(super) struct SceneDigests {
    /// Front and back.
    pub(super) sides: [SideDigests; 2],
    smudges: Option<blake3::Hash>,
}

/// Digests of one side's files.
pub(super) struct SideDigests {
    /// Those of the surface, by their part of the side.
    surface: Vec<(&'static str, blake3::Hash)>,
    pub(super) cards: Vec<blake3::Hash>,
}

impl SceneDigests {
    pub(super) fn of(files: &SceneFiles) -> Self {
        let [of_front, of_back] = &files.cards;
        Self {
            sides: [SideDigests::of(&files.front, of_front), SideDigests::of(&files.back, of_back)],
            smudges: files.smudges.as_ref().map(|map| blake3::hash(&map.bytes)),
        }
    }

    /// Makes the digests of a scene of two photographs without a map of smudges.
    pub(super) fn of_photographs(sides: [(PhotographDigests, Vec<blake3::Hash>); 2]) -> Self {
        let side = |([color, depth, mask], cards): (PhotographDigests, _)| SideDigests {
            surface: [("color", color), ("depth", depth), ("mask", mask)]
                .into_iter()
                .filter_map(|(part, digest)| Some((part, digest?)))
                .collect(),
            cards,
        };
        Self { sides: sides.map(side), smudges: None }
    }

    pub(super) fn inputs(&self) -> InputDigests {
        let hex = |digest: &blake3::Hash| digest.to_hex().to_string();
        let of_sides = ["front", "back"].into_iter().zip(&self.sides).flat_map(|(name, side)| {
            let surface =
                side.surface.iter().map(move |(part, d)| (format!("{name}.{part}"), hex(d)));
            let cards = side.cards.iter().enumerate();
            surface.chain(cards.map(move |(k, d)| (format!("{name}.{}", card_key(k)), hex(d))))
        });
        let of_map = self.smudges.iter().map(|digest| (SMUDGES_MAP.to_owned(), hex(digest)));
        InputDigests(of_sides.chain(of_map).collect())
    }
}

impl SideDigests {
    fn of(files: &SideFiles, cards: &[NamedBytes]) -> Self {
        let parts = match files {
            SideFiles::Photograph(p) => vec![
                ("color", Some(&p.color)),
                ("depth", Some(&p.depth)),
                ("mask", p.mask.as_ref()),
            ],
            SideFiles::Panorama(p) => {
                vec![("panorama", Some(&p.panorama)), ("depth", p.depth.as_ref())]
            }
            SideFiles::Mesh(file) => vec![("mesh", Some(file))],
        };
        let digest =
            |(part, file): (_, Option<&NamedBytes>)| Some((part, blake3::hash(&file?.bytes)));
        Self {
            surface: parts.into_iter().filter_map(digest).collect(),
            cards: cards.iter().map(|file| blake3::hash(&file.bytes)).collect(),
        }
    }

    /// Returns the digests of colour image, depth image and mask.
    pub(super) fn of_photograph(&self) -> PhotographDigests {
        let get = |part: &str| self.surface.iter().find(|(of, _)| *of == part).map(|(_, d)| *d);
        ["color", "depth", "mask"].map(get)
    }
}
