//! `armplane play`: the page in the browser, which is a module of the Python package.

use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

use clap::Args;
use session::{Failure, Python};

#[derive(Args)]
pub(crate) struct PlayArgs {
    /// A built-in robot or scenario, a URDF, MJCF or scenario file.
    #[arg(value_name = "ROBOT|SCENARIO|FILE", default_value = "puma560")]
    subject: String,
    /// Address to listen on; for another than this machine's own, the address of the page has a token.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    host: String,
    /// Port of the page; the next free one if it is taken.
    #[arg(long, default_value_t = 8080)]
    port: u16,
    /// Print the address, open no browser.
    #[arg(long)]
    no_open: bool,
}

/// The module, and a sentence where the package is missing.
const PAGE: &str = "import sys
try:
    from armplane.play.__main__ import main
except ModuleNotFoundError:
    print('armplane play: Python lacks the package armplane: pip install the wheel that `python/build` makes, with its extra [play]', file=sys.stderr)
    sys.exit(2)
sys.exit(main())";

/// Becomes the page.
pub(crate) fn play(args: &PlayArgs) -> Result<ExitCode, Failure> {
    let Python { program, path } = Python::find();
    let mut page = Command::new(program);
    page.args(["-c", PAGE, &args.subject, "--host", &args.host, "--port"]);
    page.arg(args.port.to_string());
    page.args(args.no_open.then_some("--no-open"));
    page.env("ARMPLANE", std::env::current_exe().map_err(Failure::work)?);
    page.envs(path.map(|path| ("PYTHONPATH", path)));
    let error = page.exec();
    Err(match error.kind() {
        ErrorKind::NotFound => Failure::Input(format!("{} viser", Python::MISSING)),
        _ => Failure::work(format!("cannot start Python: {error}")),
    })
}
