//! `armplane top`: a running graph, seen from its control page. It only reads: the run's processes are not affected.
//! Percentiles are those of the time between two samples, the longest that of the whole run.

use std::time::Duration;

use clap::Args;
use session::Failure;
use session::observation::{Living, Observer};
use session::observation_lines;

use crate::out::{is_coloured, is_gone, plain, say, size};
use crate::screen::Screen;

#[derive(Args)]
pub(crate) struct TopArgs {
    /// The run's folder or scenario; needed if several are alive (`armplane ps` lists them).
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    /// Print one sample and exit.
    #[arg(long)]
    once: bool,
    /// Sampling interval; ms.
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(10..=60_000))]
    every_ms: u64,
}

pub(crate) fn top(args: &TopArgs, as_json: bool) -> Result<bool, Failure> {
    let mut observer = Observer::open(Living::find(args.run.as_deref())?)?;
    let every = Duration::from_millis(args.every_ms);
    let mut screen = if as_json || args.once {
        None
    } else {
        Screen::open()?
    };
    let is_coloured = screen.is_some() && is_coloured(&std::io::stdout());
    loop {
        match &mut screen {
            None => std::thread::sleep(every),
            Some(screen) => {
                if screen.ends_within(every) {
                    return Ok(true);
                }
            }
        }
        let mut observation = observer.observe();
        observation.title = plain(&observation.title);
        let is_over = observer.is_over();
        if is_over {
            screen = None;
        }
        if as_json {
            say!(
                "{}",
                serde_json::to_string(&observation).map_err(Failure::work)?
            );
        } else if screen.is_some() {
            Screen::show(&observation_lines(&observation, is_coloured, size()));
        } else {
            observation_lines(&observation, false, (size().0, usize::MAX))
                .iter()
                .for_each(|line| say!("{line}"));
        }
        if args.once || is_over || is_gone() {
            if is_over && !as_json {
                say!("the run has ended");
            }
            return Ok(true);
        }
    }
}
