//! `armplane new`: a scenario to start from.

use std::path::PathBuf;

use clap::Args;
use lab::studies::Shape;
use serde_json::json;
use session::Failure;

use crate::out::say;

#[derive(Args)]
pub(crate) struct NewArgs {
    /// Name of the scenario, and of its file.
    #[arg(value_name = "NAME")]
    name: PathBuf,
    /// A built-in robot, or a URDF or MJCF file.
    #[arg(
        long,
        value_name = "NAME|FILE.urdf|FILE.xml",
        default_value = "puma560"
    )]
    robot: String,
    /// Shape of its path.
    #[arg(long, default_value = "line", value_parser = clap::builder::PossibleValuesParser::new(Shape::ALL.map(|(name, _)| name)))]
    path: String,
}

pub(crate) fn new(args: &NewArgs, as_json: bool) -> Result<bool, Failure> {
    let mut shapes = Shape::ALL.into_iter();
    let shape = shapes.find(|(name, _)| *name == args.path);
    let shape = shape.map_or(Shape::default(), |(_, shape)| shape);
    let (path, notes) = lab::studies::begin(&args.name, &args.robot, shape)?;
    let path = path.display();
    if as_json {
        say!("{}", json!({"file": path.to_string(), "notes": notes}));
    } else {
        notes.iter().for_each(|note| say!("  note: {note}"));
        say!("{path}\n  run it with `armplane run {path}`");
    }
    Ok(true)
}
