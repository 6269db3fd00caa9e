//! `man`: prints or writes the manual pages.

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::outputs::check_file;
use clap::Args as ClapArgs;
use clap::Command;
use clap_mangen::Man;
use render::atomic_file;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct ManArgs {
    /// Folder for one page per command; without --out, the command prints the main page
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(
    args: &ManArgs,
    command: Command,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let mut command = command.disable_help_subcommand(true);
    // Gives the subcommands their full names.
    command.build();
    let Some(folder) = &args.out else {
        let page = page(&command)?;
        output.show("glasshouse.man/1", &Page { page });
        return Ok(Exit::Done);
    };
    let mut pages = Vec::new();
    collect(&command, &mut pages)?;
    for (name, _) in &pages {
        check_file(&folder.join(name), "man", &is_page)?;
    }
    if !global.dry_run {
        atomic_file::create_dir(folder)?;
        for (name, page) in &pages {
            atomic_file::write_relaxed(&folder.join(name), page.as_bytes())?;
        }
    }
    let written = Written {
        out: folder.to_string_lossy(),
        dry_run: global.dry_run,
        pages: pages.iter().map(|(name, _)| name.as_str()).collect(),
        first: folder.join("glasshouse.1"),
    };
    output.show("glasshouse.man/1", &written);
    Ok(Exit::Done)
}

#[derive(Serialize)]
struct Page {
    page: String,
}

impl fmt::Display for Page {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.page.trim_end())
    }
}

#[derive(Serialize)]
struct Written<'a> {
    out: Cow<'a, str>,
    dry_run: bool,
    pages: Vec<&'a str>,
    #[serde(skip)]
    first: PathBuf,
}

impl fmt::Display for Written<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = if self.dry_run { "would write" } else { "wrote" };
        let (pages, out, first) = (self.pages.len(), &self.out, self.first.display());
        write!(f, "{verb} {pages} pages to {out}; `man -l {first}` shows the first")
    }
}

/// Collects the file names and pages of a command and its visible subcommands.
fn collect(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let name = Man::new(command.clone()).get_filename();
    pages.push((name, page(command)?));
    for inside in command.get_subcommands().filter(|inside| !inside.is_hide_set()) {
        collect(inside, pages)?;
    }
    Ok(())
}

/// Returns whether this command of any version wrote the file.
fn is_page(bytes: &[u8]) -> bool {
    String::from_utf8_lossy(bytes).contains("\n.TH glasshouse")
}

/// Renders a man page without a date, so that all machines render the same bytes.
fn page(command: &Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let version = concat!("glasshouse ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone()).source(version).manual("Glasshouse");
    man.render(&mut page).map_err(|e| Failure::new(Exit::Failed, e))?;
    String::from_utf8(page).map_err(|e| Failure::new(Exit::Failed, e))
}
