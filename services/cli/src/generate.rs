//! `armplane generate`: what shells, `man`, editors and programs in other languages read.

use std::io;
use std::path::{Path, PathBuf};

use clap::{Command, Subcommand, ValueEnum};
use clap_mangen::Man;
use session::Failure;

use crate::describe;
use crate::out::show_painted;

#[derive(Subcommand)]
pub(crate) enum Generate {
    /// Print completions for a shell.
    #[command(
        after_help = "Examples:\n  armplane generate completions bash > ~/.local/share/bash-completion/completions/armplane\n  armplane generate completions zsh > ~/.zfunc/_armplane\n  armplane generate completions fish > ~/.config/fish/completions/armplane.fish"
    )]
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Write manual pages.
    #[command(
        after_help = "Example:\n  armplane generate man ~/.local/share/man/man1 && man armplane-run"
    )]
    Man {
        /// The folder for the pages.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Print the JSON Schema of a scenario, a graph or summary.json.
    #[command(
        long_about = "Prints the JSON Schema of a scenario, a graph or summary.json: every key with its meaning and unit. Put `#:schema FILE` in the \
                      first line of a TOML file, and editors with a TOML language server (taplo, Even Better TOML) complete and check it.",
        after_help = "Examples:\n  armplane generate schema scenario > scenario.json\n  armplane generate schema summary | jq '.properties | keys'"
    )]
    Schema {
        /// The file.
        #[arg(value_enum)]
        file: Schema,
    },
    /// Print every message for other languages: offsets, sizes, units, meaning.
    #[command(
        long_about = "Prints all messages and codes. The C header declares libarmplane-process too, with which a program in any language joins a run; \
                      the Python output is the package's module `wire`. docs/wire.md shows programs.",
        after_help = "Examples:\n  armplane generate wire --lang c > armplane.h\n  armplane generate wire --lang python > python/armplane/wire.py\n  armplane generate wire --lang json | jq .topics"
    )]
    Wire {
        /// The language.
        #[arg(long, value_enum, default_value = "json")]
        lang: Language,
    },
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Schema {
    /// A scenario, as given to `armplane run`.
    Scenario,
    /// A process graph, as given to `armplane run --graph`.
    Graph,
    /// summary.json of a run.
    Summary,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Language {
    /// Structures, topics, codes and constants as one document.
    Json,
    /// A header for C11 and C++11, with the functions of libarmplane-process.
    C,
    /// The Python package's module `wire` (ctypes).
    Python,
}

pub(crate) fn generate(what: &Generate, mut command: Command) -> Result<bool, Failure> {
    let text = match what {
        Generate::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut command, "armplane", &mut script);
            String::from_utf8_lossy(&script).into_owned()
        }
        Generate::Man { folder } => {
            command = command.disable_help_subcommand(true);
            command.build();
            let written =
                std::fs::create_dir_all(folder).and_then(|()| write_pages(command, folder));
            written.map_err(|error| {
                Failure::Input(format!(
                    "cannot write to {}: {error}; choose another folder",
                    folder.display()
                ))
            })?;
            return Ok(true);
        }
        Generate::Schema { file } => match file {
            Schema::Scenario => session::schema::SCENARIO.to_owned(),
            Schema::Graph => session::schema::GRAPH.to_owned(),
            Schema::Summary => session::schema::SUMMARY.to_owned(),
        },
        Generate::Wire { lang } => match lang {
            Language::Json => format!("{:#}", describe::wire()),
            Language::C => describe::rendered(describe::C).map_err(Failure::work)?,
            Language::Python => describe::rendered(describe::PYTHON).map_err(Failure::work)?,
        },
    };
    show_painted(&format_args!("{}\n", text.trim_end()));
    Ok(true)
}

/// The page of a command, after those of its subcommands.
fn write_pages(command: Command, folder: &Path) -> io::Result<()> {
    for one in command.get_subcommands().filter(|one| !one.is_hide_set()) {
        write_pages(one.clone(), folder)?;
    }
    let (page, mut text) = (Man::new(command), Vec::new());
    page.render(&mut text)?;
    let name = page.get_filename();
    files::write(&folder.join(&name), text)
        .map_err(|error| io::Error::new(error.kind(), format!("{name}: {error}")))
}
