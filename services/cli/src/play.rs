//! `armplane play`: the page in the browser, which is a module of the Python package.

use clap::Args;
use session::{Failure, Python};

#[derive(Args)]
pub(crate) struct PlayArgs {
    /// A built-in robot or scenario, a URDF, MJCF or scenario file.
    #[arg(value_name = "ROBOT|SCENARIO|FILE", default_value = "puma560")]
    subject: String,
    /// Address to listen on; any address but this machine's own adds a token to the page's address.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    host: String,
    /// Port of the page; the next free one if it is taken.
    #[arg(long, default_value_t = 8080)]
    port: u16,
    /// Print the address, open no browser.
    #[arg(long)]
    no_open: bool,
}

/// Becomes the page.
pub(crate) fn play(args: PlayArgs) -> Failure {
    let PlayArgs {
        subject,
        host,
        port,
        no_open,
    } = args;
    let options = [
        subject,
        "--host".to_owned(),
        host,
        "--port".to_owned(),
        port.to_string(),
    ];
    let no_open = no_open.then(|| "--no-open".to_owned());
    Python::exec("play", options.into_iter().chain(no_open))
}
