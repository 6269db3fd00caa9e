//! Names in messages.

/// Number of names in a message.
const SHOWN: usize = 3;

/// Lists the first three names, and the number of the others.
pub fn first_names<T: AsRef<str>>(names: &[T]) -> String {
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    match names.len().saturating_sub(SHOWN) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}
