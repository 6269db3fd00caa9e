//! `[train]` and `[[train]]` of a recipe: the trainings that `run` starts when all tuples are complete.

use super::preset::Preset;
use super::training::TrainSettings;
use glasshouse_line::ids::SceneId;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, MapAccess, SeqAccess, Visitor, value};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::num::NonZeroU64;
use std::path::{self, Path, PathBuf};
use std::{fmt, io};

/// Names that are folders in a run's `train/` for another purpose.
const TAKEN: [&str; 3] = ["backtrack", "separation", "evaluation"];

/// One training of a recipe, with all seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainRecipe {
    /// Name of the training, whose checkpoints are in `train/NAME` of the run; without one they are in `train`. Only one
    /// training may have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Number of steps of BT-net alone.
    #[serde(default)]
    pub backtrack_steps: u64,
    /// Number of steps of SP-net and BT-net together, or of the U-Net.
    pub separation_steps: u64,
    /// Number of steps between checkpoints. Default a quarter of the steps of each stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checkpoint_every: Option<NonZeroU64>,
    /// Seeds in place of `settings.seed`: one training for each, called `NAME-seed-SEED`. They need a name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seeds: Vec<u64>,
    /// File of VGG-19's weights, from the recipe's folder; `train.json` of a run has the absolute path.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub features: Option<PathBuf>,
    /// Settings of both stages. Most defaults are from the paper or from Zhang et al.
    #[serde(default)]
    pub settings: TrainSettings,
}

/// The trainings of a recipe, in order: one of `[train]`, or several of `[[train]]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trainings(pub Vec<TrainRecipe>);

/// One training of one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct SeededTraining {
    /// Name of the folder of its checkpoints in the run's `train/`; `None` for `train/` itself.
    pub name: Option<String>,
    pub backtrack_steps: u64,
    pub separation_steps: u64,
    pub checkpoint_every: Option<NonZeroU64>,
    /// File of VGG-19's weights, if the settings need one.
    pub features: Option<PathBuf>,
    pub settings: TrainSettings,
}

impl Trainings {
    /// Makes the paths of the files of features absolute, from the recipe's folder.
    ///
    /// # Errors
    ///
    /// Fails if the current folder is unknown.
    pub fn resolve(&mut self, folder: &Path) -> io::Result<()> {
        for features in self.0.iter_mut().filter_map(|training| training.features.as_mut()) {
            *features = path::absolute(folder.join(&*features))?;
        }
        Ok(())
    }

    /// Lists the trainings of all seeds, in order.
    pub fn seeded(&self) -> Vec<SeededTraining> {
        self.0.iter().flat_map(TrainRecipe::seeded).collect()
    }

    /// Returns the training of this name; `None` stands for the training without a name.
    pub fn find(&self, name: Option<&str>) -> Option<SeededTraining> {
        self.seeded().into_iter().find(|training| training.name.as_deref() == name)
    }

    /// Returns an error if a name is not valid or not unique.
    pub(super) fn check_names(&self) -> Result<(), String> {
        for name in self.0.iter().filter_map(|training| training.name.as_deref()) {
            check_training_name(name)?;
        }
        if self.0.iter().any(|training| training.name.is_none() && !training.seeds.is_empty()) {
            return Err("a training with seeds needs a name".to_owned());
        }
        let mut names: Vec<_> = self.seeded().into_iter().map(|training| training.name).collect();
        names.sort_unstable();
        let twice = names.iter().zip(names.iter().skip(1)).find(|(name, next)| name == next);
        if let Some((name, _)) = twice {
            return Err(match name {
                Some(name) => format!("two trainings are called {name:?}: give each its own name"),
                None => "two trainings have no name: give each its own name".to_owned(),
            });
        }
        Ok(())
    }
}

impl TrainRecipe {
    fn seeded(&self) -> Vec<SeededTraining> {
        let of = |name: Option<String>, settings: TrainSettings| SeededTraining {
            name,
            backtrack_steps: self.backtrack_steps,
            separation_steps: self.separation_steps,
            checkpoint_every: self.checkpoint_every,
            features: self.features.clone(),
            settings,
        };
        if self.seeds.is_empty() {
            return vec![of(self.name.clone(), self.settings.clone())];
        }
        let seeded = |&seed: &u64| {
            let settings = TrainSettings { seed, ..self.settings.clone() };
            let name = self.name.as_deref().unwrap_or_default();
            of(Some(format!("{name}{}", ending(seed))), settings)
        };
        self.seeds.iter().map(seeded).collect()
    }
}

/// Returns the ending of the name of the training of a seed.
fn ending(seed: u64) -> String {
    format!("-seed-{seed}")
}

/// Returns the common name of the trainings of all seeds: `name` without the ending `-seed-SEED`.
pub fn name_without_seed(name: &str, seed: u64) -> Option<&str> {
    name.strip_suffix(&ending(seed)).filter(|name| !name.is_empty())
}

/// Checks the name of a training, which is also the name of a folder.
pub fn check_training_name(name: &str) -> Result<(), String> {
    if SceneId::new(name).is_err() {
        return Err(format!("the name {name:?} must be 1 to 128 characters of [A-Za-z0-9_-]"));
    }
    if TAKEN.contains(&name) || name.starts_with("step-") {
        return Err(format!("the name {name:?} is a folder of every run: choose another one"));
    }
    Ok(())
}

impl Serialize for Trainings {
    /// Writes a single training as its table, and any other number as a table with the key `trainings`.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0[..] {
            [one] => one.serialize(serializer),
            all => serializer.collect_map([("trainings", all)]),
        }
    }
}

impl<'de> Deserialize<'de> for Trainings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneOrMany)
    }
}

struct OneOrMany;

impl<'de> Visitor<'de> for OneOrMany {
    type Value = Trainings;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table [train] or a list of tables [[train]]")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Trainings, A::Error> {
        let mut table = Map::deserialize(value::MapAccessDeserializer::new(map))?;
        if let Some(Value::Array(all)) = table.remove("trainings") {
            return value::SeqDeserializer::new(all.into_iter())
                .deserialize_seq(self)
                .map_err(|e: serde_json::Error| Error::custom(e));
        }
        begin_with_preset(&mut table).map_err(Error::custom)?;
        let one = TrainRecipe::deserialize(Value::Object(table)).map_err(Error::custom)?;
        Ok(Trainings(vec![one]))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Trainings, A::Error> {
        let mut tables: Vec<Map<String, Value>> = Vec::new();
        let mut all = Vec::new();
        while let Some(mut table) = list.next_element::<Map<String, Value>>()? {
            begin_with_preset(&mut table).map_err(Error::custom)?;
            inherit(&mut table, &tables).map_err(Error::custom)?;
            let training = TrainRecipe::deserialize(Value::Object(table.clone()));
            all.push(training.map_err(|e| Error::custom(format!("{}: {e}", name_of(&table))))?);
            tables.push(table);
        }
        Ok(Trainings(all))
    }
}

fn name_of(table: &Map<String, Value>) -> String {
    let name = table.get("name").and_then(Value::as_str);
    name.map_or_else(|| "a training without a name".to_owned(), |name| format!("training {name:?}"))
}

/// Replaces the key `preset` by its settings, which the table's own settings change.
fn begin_with_preset(table: &mut Map<String, Value>) -> Result<(), String> {
    let Some(preset) = table.remove("preset") else {
        return Ok(());
    };
    let failed = |e| format!("{}: preset: {e}", name_of(table));
    let preset = TrainSettings::preset(Preset::deserialize(preset).map_err(failed)?);
    let mut settings = serde_json::to_value(preset).map_err(failed)?;
    if let (Value::Object(base), Some(Value::Object(own))) =
        (&mut settings, table.remove("settings"))
    {
        merge(base, own);
    }
    table.insert("settings".to_owned(), settings);
    Ok(())
}

/// Replaces the key `like` of a training by all keys of the earlier training of that name which the table does not have.
/// Tables in `settings` are merged key by key.
fn inherit(table: &mut Map<String, Value>, earlier: &[Map<String, Value>]) -> Result<(), String> {
    let Some(like) = table.remove("like") else {
        return Ok(());
    };
    let Some(base) = earlier.iter().find(|earlier| earlier.get("name") == Some(&like)) else {
        return Err(format!(
            "{}: like = {like}, but no training above it has that name",
            name_of(table)
        ));
    };
    let own = std::mem::replace(table, base.clone());
    merge(table, own);
    Ok(())
}

fn merge(base: &mut Map<String, Value>, own: Map<String, Value>) {
    for (key, value) in own {
        match (base.get_mut(&key), value) {
            (Some(Value::Object(base)), Value::Object(own)) => merge(base, own),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}

impl JsonSchema for Trainings {
    fn schema_name() -> Cow<'static, str> {
        "Trainings".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut one = TrainRecipe::json_schema(generator).to_value();
        one["properties"]["preset"] = generator.subschema_for::<Preset>().to_value();
        // `like` may give every required key.
        let mut listed = one.clone();
        listed["properties"]["like"] = serde_json::json!({
            "type": "string",
            "description": "Name of a training above, whose keys hold where this one has none.",
        });
        if let Some(listed) = listed.as_object_mut() {
            listed.remove("required");
        }
        json_schema!({
            "description": "One training, [train], or several with names, [[train]].",
            "anyOf": [one, { "type": "array", "items": listed, "minItems": 1 }],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::training::ExampleKind;

    fn parse(text: &str) -> Result<Trainings, String> {
        #[derive(Deserialize)]
        struct Recipe {
            train: Trainings,
        }
        toml::from_str::<Recipe>(text).map(|recipe| recipe.train).map_err(|e| e.to_string())
    }

    #[test]
    fn a_table_is_one_training_without_a_name() {
        let one = parse("[train]\nseparation_steps = 5\n[train.settings]\nwidth = 16").unwrap();
        let seeded = one.seeded();
        assert_eq!((seeded.len(), &seeded[0].name, seeded[0].settings.width), (1, &None, 16));
        let json = serde_json::to_string(&one).unwrap();
        assert_eq!(serde_json::from_str::<Trainings>(&json).unwrap(), one);
        assert!(json.starts_with(r#"{"backtrack_steps":0,"separation_steps":5,"#), "{json}");
        let error = parse("[train]\nseparation_steps = 5\nsteps = 3").unwrap_err();
        assert!(error.contains("unknown field `steps`"), "{error}");
        assert!(parse("train = 3").unwrap_err().contains("a table [train]"));
    }

    const THREE: &str = r#"
        [[train]]
        name = "a"
        separation_steps = 5
        seeds = [1, 2]
        [train.settings]
        width = 16
        composition.camera.blur_share = 0.0
        [[train]]
        name = "b"
        like = "a"
        separation_steps = 15
        [train.settings]
        examples = "composed"
        composition.camera.jpeg_share = 0.0
        composition.exposure = "of_tuple"
        [[train]]
        name = "c"
        like = "b"
        seeds = []
    "#;

    #[test]
    fn trainings_inherit_and_have_a_run_for_each_seed() {
        let all = parse(THREE).unwrap();
        all.check_names().unwrap();
        let names: Vec<String> = all.seeded().into_iter().filter_map(|t| t.name).collect();
        assert_eq!(names, ["a-seed-1", "a-seed-2", "b-seed-1", "b-seed-2", "c"]);
        let b = all.find(Some("b-seed-2")).unwrap();
        assert_eq!((b.separation_steps, b.settings.seed, b.settings.width), (15, 2, 16));
        assert_eq!(b.settings.examples, ExampleKind::Composed);
        let camera = &b.settings.composition.camera;
        assert_eq!([camera.blur_share, camera.jpeg_share], [0.0; 2]);
        assert_eq!(b.settings.composition.exposure, compose::Exposure::OfTuple);
        let a = all.find(Some("a-seed-1")).unwrap().settings.composition;
        assert_eq!(a.camera.jpeg_share, 0.7);
        assert!(all.find(Some("a")).is_none() && all.find(None).is_none());
        let json = serde_json::to_string(&all).unwrap();
        assert_eq!(serde_json::from_str::<Trainings>(&json).unwrap(), all);
        assert_eq!(name_without_seed("a-seed-1", 1), Some("a"));
        assert_eq!(name_without_seed("a-seed-1", 2), None);
        assert_eq!(name_without_seed("-seed-2", 2), None);
    }

    #[test]
    fn presets_are_the_first_settings_and_paths_start_at_the_recipe() {
        let text = "[train]\nseparation_steps = 5\npreset = \"kim2020-code\"\nfeatures = \"vgg.pth\"\n[train.settings]\nbatch = 2";
        let mut one = parse(text).unwrap();
        let expected = TrainSettings { batch: 2, ..TrainSettings::preset(Preset::Kim2020Code) };
        assert_eq!(one.seeded()[0].settings, expected);
        one.resolve(Path::new("/recipes")).unwrap();
        assert_eq!(one.seeded()[0].features.as_deref(), Some(Path::new("/recipes/vgg.pth")));
        let error = parse(&text.replace("code", "cod")).unwrap_err();
        assert!(error.contains("preset: unknown variant `kim2020-cod`"), "{error}");
    }

    #[test]
    fn wrong_names_are_refused() {
        let training = |name: &str| format!("[[train]]\nname = {name:?}\nseparation_steps = 1\n");
        let error = |names: [&str; 2]| {
            parse(&names.map(training).concat()).unwrap().check_names().unwrap_err()
        };
        assert!(error(["a", "a"]).contains("two trainings are called \"a\""));
        assert!(error(["a", "separation"]).contains("a folder of every run"));
        assert!(error(["a", "../b"]).contains("[A-Za-z0-9_-]"));
        let two = "[[train]]\nseparation_steps = 1\n".repeat(2);
        assert!(parse(&two).unwrap().check_names().unwrap_err().contains("have no name"));
        let seeds = "[train]\nseparation_steps = 1\nseeds = [1]";
        assert!(parse(seeds).unwrap().check_names().unwrap_err().contains("needs a name"));
        let unknown = THREE.replace("like = \"a\"", "like = \"z\"");
        let error = parse(&unknown).unwrap_err();
        assert!(error.contains("training \"b\": like = \"z\", but no training above"), "{error}");
        let wrong = THREE.replace("width = 16", "widht = 16");
        let error = parse(&wrong).unwrap_err();
        assert!(error.contains("training \"a\": unknown field `widht`"), "{error}");
    }
}
