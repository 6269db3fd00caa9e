use std::path::PathBuf;
pub struct Pair {
    pub name: String,
    pub blended: PathBuf,
    pub transmission: PathBuf,
    pub reflection: Option<PathBuf>,
    pub clean_reflection: Option<PathBuf>,
}
