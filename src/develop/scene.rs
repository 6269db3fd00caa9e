//! The photographs of one scene.

use super::error::DevelopError;
use crate::made::{self, Difference, Digests, Files, Made};
use crate::run::keys;
use crate::store::Store;
use bytes::Bytes;
use compose::encode_photograph;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use glasshouse_line::{SceneLine, Sensor, Split};
use render::atomic_file;
use render::merge::{
    PhotographRecord, TupleRecord, decode_tuple_exr, is_readable_record_of, photographed_layer,
    photographs,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of a scene's record, its last file.
pub const PHOTOGRAPH_RECORD: &str = "photograph.json";
/// Schema of [`PHOTOGRAPH_RECORD`].
pub const PHOTOGRAPHS_SCHEMA: &str = "glasshouse.photographs/1";

/// Content of [`PHOTOGRAPH_RECORD`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographsRecord {
    /// [`PHOTOGRAPHS_SCHEMA`].
    pub schema: String,
    pub scene: SceneId,
    pub split: Split,
    /// Version of the camera, and its factor of the light.
    pub photographs: PhotographRecord,
    /// BLAKE3 of the photographed `tuple.exr`.
    pub tuple_blake3: String,
    /// All drawn numbers.
    pub sensor: Sensor,
    /// BLAKE3 of each photograph, by its name.
    pub files: BTreeMap<String, String>,
}

/// How a scene got its photographs.
pub(super) enum Photographed {
    /// By an earlier call.
    Found,
    /// By this call; the photographs of an earlier call differed by these files.
    Now(Vec<Difference>),
}

/// The files of a call and its memory of digests.
pub(super) struct Places<'a> {
    pub(super) store: &'a Store,
    /// The tuples' files.
    pub(super) tuples: &'a Files<'a>,
    pub(super) out: &'a Path,
    pub(super) digests: &'a Digests,
}

/// Photographs a scene into `out/<scene>`, unless an earlier call did.
pub(super) fn photograph(
    places: &Places,
    line: &SceneLine,
    sensor: &Sensor,
) -> Result<Photographed, DevelopError> {
    let Places { store, tuples, out, digests } = *places;
    let folder = out.join(line.id.as_str());
    if folder.is_symlink() {
        return Err(DevelopError::Link { path: folder });
    }
    let differences = match recorded(&folder, line, sensor)? {
        Recorded::Nothing => vec![],
        Recorded::Unusable => vec![Difference::File(format!("{}/{PHOTOGRAPH_RECORD}", line.id))],
        Recorded::Made(made) => {
            let found = digests.differences(&made, tuples, &Files::results(out))?;
            if found.is_empty() {
                return Ok(Photographed::Found);
            }
            found
        }
    };
    let damaged = |name: &str, reason: &dyn std::fmt::Display| DevelopError::Damaged {
        file: keys::tuple(&line.id, name),
        reason: reason.to_string(),
    };
    let names = ["tuple.json", "tuple.exr"].map(|name| keys::tuple(&line.id, name));
    let stamp = tuples.stamp(&names[1])?;
    let files: Vec<Option<Bytes>> = store.get_all(&names)?;
    let [Some(json), Some(exr)] = &files[..] else {
        return Err(damaged(
            "tuple.exr",
            &"a file of the tuple is missing, although the scene was merged",
        ));
    };
    if !is_readable_record_of(json, line) {
        return Err(damaged("tuple.json", &"it belongs to another plan or version"));
    }
    let record: TupleRecord =
        serde_json::from_slice(json).map_err(|e| damaged("tuple.json", &e))?;
    record.check_file("tuple.exr", exr).map_err(|e| damaged("tuple.exr", &e))?;
    let layers = decode_tuple_exr(exr, &record).map_err(|e| damaged("tuple.exr", &e))?;
    if layers[Layer::Input].is_empty() {
        return Err(DevelopError::NoInput { scene: line.id.to_string() });
    }
    let scene = SceneLine { sensor: Some(sensor.clone()), ..line.clone() };
    let taken = PhotographRecord::new(sensor.exposure, &layers[Layer::Input]);
    let size = [line.film.width, line.film.height];
    atomic_file::create_dir(&folder)?;
    let tuple_blake3 = made::digest(exr);
    digests.remember(tuples, &names[1], stamp, &tuple_blake3);
    let mut written = BTreeMap::new();
    let results = Files::results(out);
    for name in photographs(&scene) {
        let layer = photographed_layer(name).expect("the name is one of a photograph");
        let file =
            encode_photograph(name, &layers[layer], size, sensor, taken.exposure_factor, line.seed)
                .map_err(|e| DevelopError::Encode {
                    scene: line.id.to_string(),
                    reason: e.to_string(),
                })?;
        let digest = made::digest(&file);
        atomic_file::write(&folder.join(name), &file)?;
        let path = format!("{}/{name}", line.id);
        digests.remember(&results, &path, results.stamp(&path)?, &digest);
        written.insert(name.to_owned(), digest);
    }
    let record = PhotographsRecord {
        schema: PHOTOGRAPHS_SCHEMA.to_owned(),
        scene: line.id.clone(),
        split: line.split,
        photographs: taken,
        tuple_blake3,
        sensor: sensor.clone(),
        files: written,
    };
    let json = serde_json::to_string_pretty(&record).expect("the record is plain data");
    atomic_file::write(&folder.join(PHOTOGRAPH_RECORD), format!("{json}\n").as_bytes())?;
    Ok(Photographed::Now(differences))
}

/// The record of an earlier call.
enum Recorded {
    Nothing,
    /// It is damaged, or that of another scene or sensor.
    Unusable,
    /// Digests of the photographs.
    Made(Made),
}

/// Reads the record of an earlier call's photographs by this sensor.
fn recorded(folder: &Path, line: &SceneLine, sensor: &Sensor) -> Result<Recorded, DevelopError> {
    let path = folder.join(PHOTOGRAPH_RECORD);
    let json = render::input_file::read_if_there(&path)
        .map_err(|source| DevelopError::Read { path, source })?;
    let Some(json) = json else { return Ok(Recorded::Nothing) };
    let record = serde_json::from_slice::<PhotographsRecord>(&json).ok();
    let record = record.filter(|record| record.scene == line.id && record.sensor == *sensor);
    let Some(record) = record else { return Ok(Recorded::Unusable) };
    let files = record.files.into_iter();
    Ok(Recorded::Made(Made {
        of: [(keys::tuple(&line.id, "tuple.exr"), record.tuple_blake3)].into(),
        files: files.map(|(name, digest)| (format!("{}/{name}", line.id), digest)).collect(),
    }))
}
