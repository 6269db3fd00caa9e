//! `man`

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use clap::Args as ClapArgs;
use clap::Command;
use clap_mangen::Man;
use render::atomic_file;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct ManArgs {
    /// Folder for a page of each command; without it the main page is printed
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
    // Gives the commands inside of it their whole names.
    command.build();
    let Some(folder) = &args.out else {
        let page = page(&command)?;
        output.show("glasshouse.man/1", &Page { page });
        return Ok(Exit::Done);
    };
    let mut pages = Vec::new();
    collect(&command, &mut pages)?;
    if !global.dry_run {
        atomic_file::create_dir(folder)?;
        for (name, page) in &pages {
            atomic_file::write_relaxed(&folder.join(name), page.as_bytes())?;
        }
    }
    let written = Written {
        out: folder.clone(),
        dry_run: global.dry_run,
        pages: pages.into_iter().map(|(name, _)| name).collect(),
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
struct Written {
    out: PathBuf,
    dry_run: bool,
    pages: Vec<String>,
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = if self.dry_run { "would write" } else { "wrote" };
        let first = self.out.join("glasshouse.1");
        write!(
            f,
            "{verb} {} pages to {}; `man -l {}` shows the first",
            self.pages.len(),
            self.out.display(),
            first.display()
        )
    }
}

/// File names and pages of a command and of all inside it.
fn collect(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let name = Man::new(command.clone()).get_filename();
    pages.push((name, page(command)?));
    for inside in command.get_subcommands().filter(|inside| !inside.is_hide_set()) {
        collect(inside, pages)?;
    }
    Ok(())
}

/// The page, the same on every machine: without the day.
fn page(command: &Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let version = concat!("glasshouse ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone()).source(version).manual("Glasshouse");
    man.render(&mut page).map_err(|e| Failure::new(Exit::Failed, e))?;
    String::from_utf8(page).map_err(|e| Failure::new(Exit::Failed, e))
}
