//! `armplane ps`: the runs that are alive.

use session::Failure;
use session::observation::Living;

use crate::out::{say_json, show};

pub(crate) fn ps(as_json: bool) -> Result<bool, Failure> {
    let living = Living::all();
    if as_json {
        say_json(&living)?;
    } else {
        show(&Living::table(&living));
    }
    Ok(true)
}
