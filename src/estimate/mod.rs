//! `depth`: a folder of pictures to depth maps and a list for recipes.
//!
//! `OUT/depth.json` identifies weights and settings. Pictures are linked (or copied) beside their depth maps, because a list's
//! paths lie below one root. A picture is done when `OUT/made.jsonl` has its digest, and those of its link and its depth map: a picture
//! that was replaced or rewritten is estimated again, and so is one whose map was damaged. The list `OUT/photographs.jsonl` is written after each call, with all pictures that are done.

mod error;
mod picture;

pub use error::EstimateError;

use crate::made::{
    DEPTH_RECORD_SCHEMA, DEPTH_RECORDS, DepthRecord, Difference, Digests, Files, Made, Remade,
    depth_records,
};
use crate::outputs::is_empty;
use depth::{DepthMap, DepthNet, Model};
use glasshouse_line::{DepthKind, ExrPrecision};
use picture::{link, read_rgb, remove};
use plan::{FolderPicture, FolderPictures};
use render::atomic_file;
use render::formats::encode_npy;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Name of the record of a folder of depth maps.
pub const DEPTH_REQUEST: &str = "depth.json";
/// Schema of [`DEPTH_REQUEST`].
pub const DEPTH_REQUEST_SCHEMA: &str = "glasshouse.depth_maps/1";
/// Name of the list of photographs.
pub const PHOTOGRAPH_LIST: &str = "photographs.jsonl";
/// Mean depths of relative maps: rooms, and the open, m.
const MEAN_M: [f64; 2] = [4.0, 12.0];

/// Identity of a folder of depth maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthRequest {
    /// [`DEPTH_REQUEST_SCHEMA`].
    pub schema: String,
    /// BLAKE3 of the file of weights.
    pub weights_blake3: String,
    /// Size of the network: `vits`, `vitb`, `vitl`.
    pub model: String,
    /// Largest depth of metric weights, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric_m: Option<f64>,
}

/// Result of a call, with the keys of `glasshouse.depth/1`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Estimated {
    /// Number of pictures with a depth map by this call.
    pub pictures: u64,
    /// Number of pictures with a depth map by earlier calls.
    pub pictures_resumed: u64,
    /// Pictures of `pictures` whose depth map by an earlier call was not that of the present picture.
    #[serde(skip_serializing_if = "Remade::is_none")]
    pub remade: Remade,
    /// Pictures without a depth map, and the reason.
    pub failed: Vec<(String, String)>,
    /// True if the stop flag ended the call early; the same call resumes.
    #[serde(skip)]
    pub stopped: bool,
}

/// What a call estimates with, and its callbacks.
pub struct EstimateWork<'a> {
    pub net: &'a DepthNet,
    pub request: &'a DepthRequest,
    /// Mean depth of relative maps in the list, m; by place if `None`.
    pub mean_m: Option<f64>,
    /// True to read all pictures and depth maps, also where nothing seems to have changed.
    pub verify: bool,
    /// Flag that ends the call after the picture in progress.
    pub stop: &'a AtomicBool,
    /// Called after each picture; true if an earlier call estimated it.
    pub on_picture: &'a dyn Fn(bool),
}

impl DepthRequest {
    pub fn new(weights_blake3: &str, model: Model, metric_m: Option<f64>) -> Self {
        Self {
            schema: DEPTH_REQUEST_SCHEMA.to_owned(),
            weights_blake3: weights_blake3.to_owned(),
            model: model.name().to_owned(),
            metric_m,
        }
    }

    /// Claims a folder: a new or empty one, or one with depth maps of the same request.
    fn claim(&self, out: &Path) -> Result<(), EstimateError> {
        let path = out.join(DEPTH_REQUEST);
        let read = |source| EstimateError::Read { path: path.clone(), source };
        if path.exists() {
            let bytes = render::input_file::read(&path).map_err(read)?;
            return match serde_json::from_slice::<Self>(&bytes) {
                Ok(there) if there == *self => Ok(()),
                _ => Err(EstimateError::Foreign { out: out.to_owned() }),
            };
        }
        atomic_file::create_dir(out)?;
        if !is_empty(out).map_err(read)? {
            return Err(EstimateError::Foreign { out: out.to_owned() });
        }
        let json = serde_json::to_string_pretty(self).expect("the request is plain data");
        Ok(atomic_file::write(&path, format!("{json}\n").as_bytes())?)
    }
}

/// Returns the path of a picture's depth map, relative to the folder of depth maps.
pub fn depth_path(picture: &str) -> String {
    let stem = picture.rsplit_once('.').map_or(picture, |(stem, _)| stem);
    format!("{stem}_depth.npy")
}

/// Estimates the depth of all pictures of a folder.
pub fn estimate(
    folder: &Path,
    found: &FolderPictures,
    out: &Path,
    work: &EstimateWork,
) -> Result<Estimated, EstimateError> {
    work.request.claim(out)?;
    let mut estimated = Estimated { failed: found.unreadable.clone(), ..Estimated::default() };
    let (mut taken, mut listed) = (BTreeSet::new(), Vec::new());
    let (records, digests) = (depth_records(out)?, Digests::open(out, work.verify));
    let [pictures, results] = [Files::inputs(folder), Files::results(out)];
    for picture in &found.pictures {
        let name = &picture.photograph.color;
        let map = depth_path(name);
        if !taken.insert(map.clone()) {
            let reason = format!("another picture has the depth map {map}: rename one of them");
            estimated.failed.push((name.clone(), reason));
            continue;
        }
        let [from, target, copy] = [folder.join(name), out.join(&map), out.join(name)];
        let differences = match records.get(name) {
            Some(made) => Some(digests.differences(made, &pictures, &results)?),
            None if target.is_file() => {
                Some(vec![Difference::FileGone(format!("a line of {map} in {DEPTH_RECORDS}"))])
            }
            None => None,
        };
        let is_done = differences.as_ref().is_some_and(Vec::is_empty);
        if is_done {
            estimated.pictures_resumed += 1;
        } else if work.stop.load(Ordering::Relaxed) {
            estimated.stopped = true;
            continue;
        } else {
            let before = digests.of(&pictures, name)?;
            match one(work.net, &from, picture) {
                Ok(depth) => {
                    create_parent(&target)?;
                    // A depth map exists only beside its own picture, whenever the call is killed.
                    remove(&target)?;
                    link(&from, &copy)?;
                    let shape = [depth.height, depth.width];
                    let npy = encode_npy(&shape, &depth.values, ExrPrecision::Float);
                    atomic_file::write(&target, &npy)?;
                    record(out, name, (before, [name, &map]), &digests)?;
                    // The link changed the time of the picture's inode.
                    digests.of(&pictures, name)?;
                    estimated.pictures += 1;
                    if let Some(differences) = differences {
                        estimated.remade.add(1, &differences);
                    }
                }
                Err(reason) => {
                    estimated.failed.push((name.clone(), reason));
                    (work.on_picture)(false);
                    continue;
                }
            }
        }
        (work.on_picture)(is_done);
        listed.push(line(picture, &map, work).to_string());
    }
    digests.write(out)?;
    if !listed.is_empty() {
        let list = listed.join("\n") + "\n";
        atomic_file::write(&out.join(PHOTOGRAPH_LIST), list.as_bytes())?;
    }
    Ok(estimated)
}

/// Records the digests of a picture before it was read, and of its files.
fn record(
    out: &Path,
    picture: &str,
    (before, files): (Option<String>, [&str; 2]),
    digests: &Digests,
) -> Result<(), EstimateError> {
    let mut made = Made {
        of: before.map(|of| (picture.to_owned(), of)).into_iter().collect(),
        ..Made::default()
    };
    for file in files {
        let digest = digests.of(&Files::results(out), file)?;
        made.files.extend(digest.map(|digest| (file.to_owned(), digest)));
    }
    let record =
        DepthRecord { schema: DEPTH_RECORD_SCHEMA.to_owned(), picture: picture.to_owned(), made };
    let line = serde_json::to_string(&record).expect("texts are JSON");
    Ok(atomic_file::append_line(&out.join(DEPTH_RECORDS), &line)?)
}

fn create_parent(path: &Path) -> Result<(), EstimateError> {
    let parent = path.parent().map_or_else(PathBuf::new, Path::to_owned);
    Ok(atomic_file::create_dir(&parent)?)
}

/// Estimates the depth of one picture. An error is a text for the user.
fn one(net: &DepthNet, path: &Path, picture: &FolderPicture) -> Result<DepthMap, String> {
    let rgb = read_rgb(path, picture.photograph.transfer)?;
    net.estimate(rgb).map_err(|e| e.to_string())
}

/// Makes a picture's line of the list.
fn line(picture: &FolderPicture, map: &str, work: &EstimateWork) -> serde_json::Value {
    let photograph = &picture.photograph;
    let mut line = json!({
        "schema": plan::PHOTOGRAPH_SCHEMA,
        "place": picture.place.name(),
        "color": photograph.color,
        "depth": map,
        "transfer": photograph.transfer,
        "intrinsics": photograph.intrinsics,
    });
    if work.request.metric_m.is_none() {
        let [indoors, outdoor] = MEAN_M;
        let by_place = if picture.place == plan::Place::Indoors { indoors } else { outdoor };
        let mean_m = work.mean_m.unwrap_or(by_place);
        line["depth_kind"] = json!(DepthKind::RelativeInverse);
        line["depth_range"] = json!({ "mean_m": mean_m });
    }
    line
}
