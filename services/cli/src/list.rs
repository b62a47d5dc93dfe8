//! `armplane list`.

use session::{Catalogue, Failure};

use crate::out::answer;

pub(crate) fn list(as_json: bool) -> Result<bool, Failure> {
    let catalogue = Catalogue::load()?;
    answer(as_json, &catalogue.json(), &catalogue);
    Ok(true)
}
