//! `man`

use super::args::{Args, Global};
use super::exit_code::{Exit, Failure};
use super::look_args::ManArgs;
use super::output::Output;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use render::atomic_file;
use serde_json::json;

pub(super) fn run(args: &ManArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let mut command = Args::command().disable_help_subcommand(true);
    // Gives the commands inside of it their whole names.
    command.build();
    let Some(folder) = &args.out else {
        let page = page(&command)?;
        output.result("glasshouse.man/1", json!({ "page": page }), page.trim_end());
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
    let verb = if global.dry_run {
        "would write"
    } else {
        "wrote"
    };
    let text = format!(
        "{verb} {} pages to {}; `man -l {}` shows the first",
        pages.len(),
        folder.display(),
        folder.join("glasshouse.1").display()
    );
    let names: Vec<&String> = pages.iter().map(|(name, _)| name).collect();
    let object = json!({ "out": folder, "dry_run": global.dry_run, "pages": names });
    output.result("glasshouse.man/1", object, &text);
    Ok(Exit::Done)
}

/// File names and pages of a command and of all inside it.
fn collect(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), Failure> {
    let name = Man::new(command.clone()).get_filename();
    pages.push((name, page(command)?));
    for inside in command
        .get_subcommands()
        .filter(|inside| !inside.is_hide_set())
    {
        collect(inside, pages)?;
    }
    Ok(())
}

/// The page, the same on every machine: without the day.
fn page(command: &Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let version = concat!("glasshouse ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone())
        .source(version)
        .manual("Glasshouse");
    man.render(&mut page)
        .map_err(|e| Failure::new(Exit::Failed, e))?;
    String::from_utf8(page).map_err(|e| Failure::new(Exit::Failed, e))
}
