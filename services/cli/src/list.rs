//! `armplane list`.

use std::process::ExitCode;

use session::{Catalogue, Failure};

use crate::out::{say, show};

pub(crate) fn list(as_json: bool) -> Result<ExitCode, Failure> {
    let catalogue = Catalogue::load()?;
    match as_json {
        true => say!("{}", catalogue.json()),
        false => show(&catalogue),
    }
    Ok(ExitCode::SUCCESS)
}
