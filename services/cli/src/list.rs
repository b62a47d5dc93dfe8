//! `armplane list`.

use std::process::ExitCode;

use session::{Catalogue, Failure};

use crate::out::answer;

pub(crate) fn list(as_json: bool) -> Result<ExitCode, Failure> {
    let catalogue = Catalogue::load()?;
    answer(as_json, &catalogue.json(), &catalogue);
    Ok(ExitCode::SUCCESS)
}
