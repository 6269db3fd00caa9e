//! What the declaration of a key gives: its checks in lines and recipes, its draws, and its rows in tables.
//!
//! `#[keys]` (`glasshouse_keys`) implements [`Keys`] and [`Drawn`] for a section; this file has the numbers, lists, options and
//! words that sections consist of.

pub use crate::param::Drawing;

use crate::SceneLine;
use crate::limits::Limit;
use crate::param::Param;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::LazyLock;

/// A declared key.
#[derive(Debug)]
pub struct Key {
    pub name: &'static str,
    /// What it means, in a sentence or two.
    pub text: &'static str,
    /// Limits of the number, or of the elements of a list: the last one holds for all further elements. Empty for words and tables.
    pub limits: &'static [Limit],
    /// Default in lines, for readers.
    pub default: Option<&'static str>,
    /// Default in recipes, for readers.
    pub recipe_default: Option<&'static str>,
    /// True if the key may be missing without a default.
    pub is_optional: bool,
    /// True if the value decides whether pane, lens and film fit together.
    pub decides: bool,
    pub in_lines: bool,
    pub in_recipes: bool,
}

/// A place in a line or a recipe: the dotted path of a key, and its declaration.
#[derive(Clone, Debug)]
pub struct At<'k> {
    pub path: String,
    /// The declaration; `None` for the root.
    pub key: Option<&'k Key>,
    /// Position in a list of numbers.
    element: usize,
    /// Whether lines and recipes have the section of the key.
    in_lines: bool,
    in_recipes: bool,
}

impl At<'static> {
    /// Returns the place of a section, such as `glass`.
    pub fn section(path: impl Into<String>) -> Self {
        Self { path: path.into(), key: None, element: 0, in_lines: true, in_recipes: true }
    }
}

impl<'k> At<'k> {
    /// Returns the place of a key of this section.
    pub fn key<'n>(&self, key: &'n Key) -> At<'n> {
        let dot = if self.path.is_empty() { "" } else { "." };
        At {
            path: format!("{}{dot}{}", self.path, key.name),
            key: Some(key),
            element: 0,
            in_lines: self.in_lines && key.in_lines,
            in_recipes: self.in_recipes && key.in_recipes,
        }
    }

    /// Returns a place below this one with the same declaration.
    pub(crate) fn below(&self, name: &str) -> At<'k> {
        At { path: format!("{}.{name}", self.path), ..self.clone() }
    }

    /// Returns the place of a form of this section, whose keys stand in a table with the form's name.
    pub(crate) fn form(&self, name: &str) -> At<'k> {
        self.below(name)
    }

    /// Returns the place of an element of this list.
    pub(crate) fn element(&self, index: usize) -> At<'k> {
        At { path: format!("{}[{index}]", self.path), element: index, ..self.clone() }
    }

    /// Returns the declared limit of a number.
    ///
    /// # Panics
    ///
    /// If the key of a number was declared without a range.
    pub fn limit(&self) -> Limit {
        let limits = self.key.map_or(&[][..], |key| key.limits);
        let limit = limits.get(self.element).or(limits.last());
        *limit.unwrap_or_else(|| panic!("{} is declared without a range", self.path))
    }
}

/// A row of the tables of keys.
#[derive(Clone, Debug)]
pub struct Row {
    /// Dotted path without indices.
    pub path: String,
    pub key: &'static Key,
    /// Number of elements of a list of numbers, 1 for a number, 0 for a word or a table.
    pub numbers: usize,
    pub in_lines: bool,
    pub in_recipes: bool,
}

impl Row {
    /// Returns the paths of the numbers, with the index of each element of a list.
    pub fn paths(&self) -> Vec<String> {
        match self.numbers {
            0 => vec![],
            1 => vec![self.path.clone()],
            count => (0..count).map(|index| format!("{}[{index}]", self.path)).collect(),
        }
    }
}

/// Receives the numbers of a line with their places.
pub type Visit<'v> = dyn FnMut(&At<'_>, f64) + 'v;
/// Receives the distributions of a recipe with their places.
pub type VisitParams<'v, 'r> = dyn FnMut(&At<'_>, &'r Param) + 'v;

/// A value of a scene line.
pub trait Keys {
    /// Appends the rows of the keys at and below `at`.
    fn rows(at: &At<'static>, rows: &mut Vec<Row>);
    /// Visits all numbers at and below `at`.
    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>);
}

/// A value of a scene line that scenes draw from a recipe.
pub trait Drawn: Keys + Sized {
    /// What the recipe has in place of the value.
    type Recipe: Clone + Debug + PartialEq + DeserializeOwned + JsonSchema;

    /// Visits all distributions at and below `at`.
    fn params<'r>(recipe: &'r Self::Recipe, at: &At<'_>, visit: &mut VisitParams<'_, 'r>);
    /// Draws the value.
    fn draw(recipe: &Self::Recipe, at: &At<'_>, draw: &dyn Drawing) -> Self;

    /// Returns the recipe in which all scenes have this value.
    ///
    /// # Panics
    ///
    /// For sections, whose keys have defaults of their own.
    fn constant(self) -> Self::Recipe {
        panic!("a section has no constant")
    }
}

/// Returns the rows of all keys of a line, and of the recipe's sections with the same keys.
pub fn declared_rows() -> Vec<Row> {
    let mut rows = Vec::new();
    SceneLine::rows(&At::section(""), &mut rows);
    rows
}

/// Returns the limit of a number by its key, such as `glass.tilt_deg[1]`; `None` if no such number is declared.
pub fn limit_of(path: &str) -> Option<Limit> {
    static LIMITS: LazyLock<BTreeMap<String, Limit>> = LazyLock::new(|| {
        let rows = declared_rows();
        let limit =
            |row: &Row, element| row.key.limits.get(element).or(row.key.limits.last()).copied();
        let of_row = |row: &Row| -> Vec<(String, Limit)> {
            let paths = row.paths().into_iter().enumerate();
            let elements = paths.filter_map(|(element, path)| Some((path, limit(row, element)?)));
            elements.chain(limit(row, 0).map(|limit| (row.path.clone(), limit))).collect()
        };
        rows.iter().filter(|row| row.numbers > 0).flat_map(of_row).collect()
    });
    LIMITS.get(path).copied()
}

/// A distribution of a recipe with the declaration of its key.
#[derive(Clone, Debug)]
pub struct Number<'r> {
    /// Dotted path with indices, such as `glass.tilt_deg[0]`.
    pub path: String,
    pub param: &'r Param,
    pub limit: Limit,
    /// As in [`Key::decides`].
    pub decides: bool,
}

/// Returns all distributions of a recipe's section.
pub fn numbers_of<'r, T: Drawn>(recipe: &'r T::Recipe, section: &str) -> Vec<Number<'r>> {
    let mut numbers = Vec::new();
    T::params(recipe, &At::section(section), &mut |at, param| {
        let decides = at.key.is_some_and(|key| key.decides);
        numbers.push(Number { path: at.path.clone(), param, limit: at.limit(), decides });
    });
    numbers
}

pub(crate) fn row(at: &At<'static>, numbers: usize) -> Row {
    let key = at.key.expect("a row stands for a declared key");
    let (in_lines, in_recipes) = (at.in_lines, at.in_recipes);
    Row { path: at.path.clone(), key, numbers, in_lines, in_recipes }
}

/// Implements [`Keys`] and [`Drawn`] for a type of numbers.
macro_rules! numbers {
    ($($number:ty),*) => {
        $(
            impl Keys for $number {
                fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
                    rows.push(row(at, 1));
                }

                fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
                    visit(at, f64::from(*self));
                }
            }

            impl Drawn for $number {
                type Recipe = Param;

                fn params<'r>(param: &'r Param, at: &At<'_>, visit: &mut VisitParams<'_, 'r>) {
                    visit(at, param);
                }

                fn draw(param: &Param, at: &At<'_>, draw: &dyn Drawing) -> Self {
                    // The limits of whole numbers hold no other draws.
                    draw.value(&at.path, param) as $number
                }

                fn constant(self) -> Param {
                    Param::Constant(f64::from(self))
                }
            }
        )*
    };
}
numbers!(f64, u32, u8);

impl<T: Keys, const N: usize> Keys for [T; N] {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        let first = rows.len();
        T::rows(at, rows);
        rows[first..].iter_mut().for_each(|row| row.numbers *= N);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        self.iter().enumerate().for_each(|(index, one)| one.numbers(&at.element(index), visit));
    }
}

impl<T: Drawn, const N: usize> Drawn for [T; N]
where
    [T::Recipe; N]: DeserializeOwned + JsonSchema,
{
    type Recipe = [T::Recipe; N];

    fn params<'r>(recipe: &'r Self::Recipe, at: &At<'_>, visit: &mut VisitParams<'_, 'r>) {
        recipe.iter().enumerate().for_each(|(k, one)| T::params(one, &at.element(k), visit));
    }

    fn draw(recipe: &Self::Recipe, at: &At<'_>, draw: &dyn Drawing) -> Self {
        std::array::from_fn(|index| T::draw(&recipe[index], &at.element(index), draw))
    }

    fn constant(self) -> Self::Recipe {
        self.map(T::constant)
    }
}

impl<T: Keys> Keys for Option<T> {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        T::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        if let Some(value) = self {
            value.numbers(at, visit);
        }
    }
}

impl<T: Drawn> Drawn for Option<T> {
    type Recipe = Option<T::Recipe>;

    fn params<'r>(recipe: &'r Self::Recipe, at: &At<'_>, visit: &mut VisitParams<'_, 'r>) {
        if let Some(recipe) = recipe {
            T::params(recipe, at, visit);
        }
    }

    fn draw(recipe: &Self::Recipe, at: &At<'_>, draw: &dyn Drawing) -> Self {
        recipe.as_ref().map(|recipe| T::draw(recipe, at, draw))
    }

    fn constant(self) -> Self::Recipe {
        self.map(T::constant)
    }
}

impl<T: Keys> Keys for Vec<T> {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        T::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        self.iter().enumerate().for_each(|(index, one)| one.numbers(&at.element(index), visit));
    }
}

/// Implements [`Keys`] for types without numbers, which are words, paths and tables.
macro_rules! words {
    ($($word:ty),* $(,)?) => {
        $(
            impl crate::keys::Keys for $word {
                fn rows(at: &crate::keys::At<'static>, rows: &mut Vec<crate::keys::Row>) {
                    rows.push(crate::keys::row(at, 0));
                }

                fn numbers(&self, _: &crate::keys::At<'_>, _: &mut crate::keys::Visit<'_>) {}
            }
        )*
    };
}

/// Implements [`Keys`] and [`Drawn`] for words that are the same in all scenes of a recipe.
macro_rules! words_of_all_scenes {
    ($($word:ty),* $(,)?) => {
        crate::keys::words!($($word),*);
        $(
            impl crate::keys::Drawn for $word {
                type Recipe = Self;

                fn params<'r>(
                    _: &'r Self,
                    _: &crate::keys::At<'_>,
                    _: &mut crate::keys::VisitParams<'_, 'r>,
                ) {
                }

                fn draw(
                    word: &Self,
                    _: &crate::keys::At<'_>,
                    _: &dyn crate::keys::Drawing,
                ) -> Self {
                    word.clone()
                }

                fn constant(self) -> Self {
                    self
                }
            }
        )*
    };
}

pub(crate) use {words, words_of_all_scenes};

words!(String, u64);
words_of_all_scenes!(bool);
