//! The photographs of one scene.

use super::error::DevelopError;
use crate::run::keys;
use crate::store::Store;
use bytes::Bytes;
use compose::encode_photograph;
use render::atomic_file;
use render::ids::SceneId;
use render::layer::Layer;
use render::line::{SceneLine, Sensor, Split};
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

/// Photographs a scene into `out/<scene>`. Returns true if an earlier call did.
pub(super) fn photograph(
    store: &Store,
    line: &SceneLine,
    sensor: &Sensor,
    out: &Path,
) -> Result<bool, DevelopError> {
    let folder = out.join(line.id.as_str());
    if is_complete(&folder, line, sensor) {
        return Ok(true);
    }
    let damaged = |name: &str, reason: &dyn std::fmt::Display| DevelopError::Damaged {
        file: keys::tuple(&line.id, name),
        reason: reason.to_string(),
    };
    let names = ["tuple.json", "tuple.exr"].map(|name| keys::tuple(&line.id, name));
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
    let mut digests = BTreeMap::new();
    for name in photographs(&scene) {
        let layer = photographed_layer(name).expect("the name is one of a photograph");
        let file =
            encode_photograph(name, &layers[layer], size, sensor, taken.exposure_factor, line.seed)
                .map_err(|e| DevelopError::Encode {
                    scene: line.id.to_string(),
                    reason: e.to_string(),
                })?;
        digests.insert(name.to_owned(), blake3::hash(&file).to_hex().to_string());
        atomic_file::write(&folder.join(name), &file)?;
    }
    let record = PhotographsRecord {
        schema: PHOTOGRAPHS_SCHEMA.to_owned(),
        scene: line.id.clone(),
        split: line.split,
        photographs: taken,
        tuple_blake3: blake3::hash(exr).to_hex().to_string(),
        sensor: sensor.clone(),
        files: digests,
    };
    let json = serde_json::to_string_pretty(&record).expect("the record is plain data");
    atomic_file::write(&folder.join(PHOTOGRAPH_RECORD), format!("{json}\n").as_bytes())?;
    Ok(false)
}

/// True if the folder has the complete photographs of a scene by a sensor. Damage is left to the digests.
fn is_complete(folder: &Path, line: &SceneLine, sensor: &Sensor) -> bool {
    let Ok(json) = render::input_file::read(&folder.join(PHOTOGRAPH_RECORD)) else {
        return false;
    };
    serde_json::from_slice::<PhotographsRecord>(&json).is_ok_and(|record| {
        record.scene == line.id
            && record.sensor == *sensor
            && record.files.keys().all(|name| folder.join(name).is_file())
    })
}
