//! A mistake in a command's arguments, in one sentence: cause and remedy.

use clap::Command;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use shared_types::file::nearest;

/// The standard library's words for a text that is no number, and the remedy.
const NO_NUMBERS: [(&str, &str); 5] = [
    (
        "invalid digit found in string",
        "give a whole number, from 0",
    ),
    (
        "cannot parse integer from empty string",
        "give a whole number",
    ),
    (
        "number too large to fit in target type",
        "give a smaller number",
    ),
    ("invalid float literal", "give a number"),
    ("cannot parse float from empty string", "give a number"),
];

/// The sentence for an error of these words on a command line.
pub(crate) fn sentence(error: &clap::Error, command: &Command, words: &[String]) -> String {
    let called = words.iter().find_map(|word| command.find_subcommand(word));
    let of = |kind| match error.get(kind) {
        Some(ContextValue::String(one)) => one.clone(),
        Some(ContextValue::Strings(all)) => all.join(", "),
        _ => String::new(),
    };
    let (argument, value) = (of(ContextKind::InvalidArg), of(ContextKind::InvalidValue));
    let known = of(ContextKind::ValidValue);
    let (cause, remedy) = match error.kind() {
        ErrorKind::InvalidSubcommand => {
            let word = of(ContextKind::InvalidSubcommand);
            (
                format!("there is no command '{word}'"),
                no_command(&word, command),
            )
        }
        ErrorKind::UnknownArgument => {
            let remedy = called.and_then(|here| no_argument(&argument, here, command, words));
            (format!("unexpected argument '{argument}'"), remedy)
        }
        ErrorKind::InvalidValue if value.is_empty() => {
            let listed = format!("give one of {known}");
            (
                format!("'{argument}' has no value"),
                Some(listed).filter(|_| !known.is_empty()),
            )
        }
        ErrorKind::InvalidValue => {
            let near = nearest(&value, known.split(", "));
            let listed = || format!("give one of {known}");
            (
                format!("'{value}' for '{argument}'"),
                Some(near.map_or_else(listed, did_you_mean)),
            )
        }
        ErrorKind::ValueValidation => {
            let why = std::error::Error::source(error).map(ToString::to_string);
            let plain = NO_NUMBERS
                .iter()
                .find(|(words, _)| Some(*words) == why.as_deref());
            (
                format!("'{value}' for '{argument}'"),
                plain.map(|(_, remedy)| (*remedy).to_owned()).or(why),
            )
        }
        ErrorKind::ArgumentConflict => {
            let other = of(ContextKind::PriorArg);
            (
                format!("'{argument}' cannot stand beside '{other}'"),
                Some("leave one out".to_owned()),
            )
        }
        ErrorKind::MissingRequiredArgument => (format!("{argument} is missing"), None),
        _ => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            (first.trim_start_matches("error: ").to_owned(), None)
        }
    };
    let help = || {
        let name = called.map_or(String::new(), |called| format!("{} ", called.get_name()));
        format!("`armplane {name}--help` shows how it is used")
    };
    format!("{cause}: {}", remedy.unwrap_or_else(help))
}

fn did_you_mean(name: &str) -> String {
    format!("did you mean `{name}`?")
}

/// The commands for people.
fn commands(command: &Command) -> impl Iterator<Item = &Command> {
    command.get_subcommands().filter(|one| !one.is_hide_set())
}

/// The remedy for a word that is no command.
fn no_command(word: &str, command: &Command) -> Option<String> {
    if session::load::Source::read(word).is_ok() {
        return Some(format!("`armplane run {word}` runs a scenario"));
    }
    let names: Vec<_> = commands(command).map(Command::get_name).collect();
    nearest(word, names.into_iter()).map(did_you_mean)
}

/// The remedy for an argument that a command does not take.
fn no_argument(argument: &str, here: &Command, all: &Command, words: &[String]) -> Option<String> {
    // Of a word such as `-60` it names the first letter.
    let place = words.iter().position(|word| word.starts_with(argument))?;
    let is_number = |word: &&String| word.split(',').all(|part| part.parse::<f64>().is_ok());
    if argument.starts_with('-') && is_number(&&words[place]) {
        let first = words[..place].iter().rposition(|word| !is_number(&word))?;
        let numbers: Vec<_> = words[first + 1..]
            .iter()
            .take_while(is_number)
            .cloned()
            .collect();
        return Some(format!(
            "several numbers are one word, {}={}",
            words[first],
            numbers.join(",")
        ));
    }
    let has = |of: &Command, name: &str| of.get_arguments().any(|one| one.get_long() == Some(name));
    let Some(option) = argument.strip_prefix("--") else {
        return match (here.get_name(), here.get_positionals().count()) {
            _ if argument.starts_with('-') => None,
            ("run", _) => {
                Some("one scenario at a time; `armplane compare` takes several".to_owned())
            }
            (_, 0) if has(here, "robot") => Some(format!("give an arm as --robot {argument}")),
            (_, takes) => Some(format!(
                "it takes {takes}; a name with spaces stands in quotes"
            )),
        };
    };
    if (here.get_name(), option) == ("run", "robot") {
        return Some(
            "a scenario names its robot; `armplane new NAME --robot ROBOT` writes one".to_owned(),
        );
    }
    let own: Vec<_> = here
        .get_arguments()
        .filter_map(clap::Arg::get_long)
        .collect();
    let others: Vec<_> = commands(all)
        .filter(|one| has(one, option))
        .map(Command::get_name)
        .collect();
    match nearest(option, own.into_iter()) {
        Some(near) => Some(did_you_mean(&format!("--{near}"))),
        None if others.is_empty() => {
            has(here, "set").then(|| "a key of the scenario is given by --set KEY=VALUE".to_owned())
        }
        None => Some(format!(
            "it is an option of `armplane {}`",
            others.join("`, `armplane ")
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_mistake_leads_to_its_remedy() {
        for (line, remedy) in [
            ("rnu ok.toml", "`run`"),
            ("fig5-wrist-rotation", "`armplane run fig5-wrist-rotation`"),
            ("run --sed 3", "`--seed`"),
            ("run --seed -1", "'-1' for '--seed <N>'"),
            ("run --robot ur5", "--robot ROBOT`"),
            ("run a.toml b.toml", "`armplane compare`"),
            ("run --mode realtim", "`realtime`"),
            ("run --mode", "lockstep"),
            ("run --rate 500", "--set"),
            (
                "inspect --q-deg 20 -60 80 -110 60 30",
                "--q-deg=20,-60,80,-110,60,30",
            ),
            ("inspect --count 3", "`armplane compare`"),
            ("inspect ur5", "--robot ur5"),
            ("run --from a@1 --seed 2", "'--from"),
        ] {
            let words: Vec<_> = line.split(' ').map(str::to_owned).collect();
            let command = crate::command();
            let all = ["armplane"].into_iter().chain(line.split(' '));
            let error = command.clone().try_get_matches_from(all).unwrap_err();
            let said = sentence(&error, &command, &words);
            assert!(said.contains(remedy), "{line}: {said}");
        }
    }
}
