//! `libella report`

use std::path::{Path, PathBuf};

use libella_host::fault::Fault;
use libella_host::report::{write_comparison, write_page};

use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Output folders of `libella run`: of one a page is made in it, several are compared on one page.
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// The page that compares several [default: compare.html in the working directory].
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let path = match (arguments.folders.as_slice(), &arguments.out) {
        ([folder], None) => write_page(folder)?,
        (folders, out) => {
            let path = out.clone().unwrap_or_else(|| Path::new("compare.html").into());
            write_comparison(folders, &path)?;
            path
        }
    };
    say(&format!("report          {}\n", path.display()));
    Ok(Exit::Done)
}
