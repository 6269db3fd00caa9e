//! `man`

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use clap::Args as ClapArgs;
use clap::Command;
use clap_mangen::Man;
use render::atomic_file;
use serde_json::json;
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
pub(super) struct ManArgs {
    /// Folder for one page per command; without it the main page is printed
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
        output.say("glasshouse.man/1", json!({ "page": page }), page.trim_end());
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
    let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
    let object = json!({
        "out": folder.to_string_lossy(), "dry_run": global.dry_run, "pages": names,
    });
    let text = format!(
        "{} {} pages to {}; `man -l {}` shows the first",
        if global.dry_run { "would write" } else { "wrote" },
        names.len(),
        folder.display(),
        folder.join("glasshouse.1").display()
    );
    output.say("glasshouse.man/1", object, text);
    Ok(Exit::Done)
}

/// Collects file names and pages of a command and its subcommands.
fn collect(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let name = Man::new(command.clone()).get_filename();
    pages.push((name, page(command)?));
    for inside in command.get_subcommands().filter(|inside| !inside.is_hide_set()) {
        collect(inside, pages)?;
    }
    Ok(())
}

/// A man page without a date, so that it is the same on every machine.
fn page(command: &Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let version = concat!("glasshouse ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone()).source(version).manual("Glasshouse");
    man.render(&mut page).map_err(|e| Failure::new(Exit::Failed, e))?;
    String::from_utf8(page).map_err(|e| Failure::new(Exit::Failed, e))
}
