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
    let called = called(command, words);
    let (cause, remedy) = cause_and_remedy(error, called, command, words);
    let help = || {
        let name = called.map_or(String::new(), |called| format!("{} ", called.get_name()));
        format!("`armplane {name}--help` shows how it is used")
    };
    format!("{cause}: {}", remedy.unwrap_or_else(help))
}

fn cause_and_remedy(
    error: &clap::Error,
    called: Option<&Command>,
    command: &Command,
    words: &[String],
) -> (String, Option<String>) {
    let of = |kind| match error.get(kind) {
        Some(ContextValue::String(one)) => one.clone(),
        Some(ContextValue::Strings(all)) => all.join(", "),
        _ => String::new(),
    };
    let (argument, value) = (of(ContextKind::InvalidArg), of(ContextKind::InvalidValue));
    let known = of(ContextKind::ValidValue);
    match error.kind() {
        ErrorKind::InvalidSubcommand => {
            let word = of(ContextKind::InvalidSubcommand);
            (
                format!("there is no command '{word}'"),
                no_command(&word, command),
            )
        }
        ErrorKind::UnknownArgument => {
            let remedy = called.and_then(|here| no_argument(&argument, here, command, words));
            // Of a word such as `-90` it names the first letter.
            let is_short =
                |word: &&String| !argument.starts_with("--") && word.starts_with(&argument);
            let word = words.iter().find(is_short).unwrap_or(&argument);
            (format!("unexpected argument '{word}'"), remedy)
        }
        ErrorKind::InvalidValue => no_choice(&argument, &value, &known, called),
        ErrorKind::ValueValidation => {
            let why = std::error::Error::source(error).map(ToString::to_string);
            (
                format!("'{value}' for '{argument}'"),
                no_value(&argument, why.unwrap_or_default(), called, words),
            )
        }
        ErrorKind::ArgumentConflict => {
            let other = of(ContextKind::PriorArg);
            (
                format!("'{argument}' cannot stand beside '{other}'"),
                Some("leave one out".to_owned()),
            )
        }
        ErrorKind::MissingRequiredArgument => {
            let known = called.and_then(|called| values(called, &argument));
            let remedy = known.or_else(|| example(called?, ""));
            (format!("{argument} is missing"), remedy)
        }
        _ => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            (first.trim_start_matches("error: ").to_owned(), None)
        }
    }
}

/// Of an argument that takes one of the `known` values, where there are any, and was given none or another.
fn no_choice(
    argument: &str,
    value: &str,
    known: &str,
    called: Option<&Command>,
) -> (String, Option<String>) {
    let listed = Some(format!("give one of {known}")).filter(|_| !known.is_empty());
    if value.is_empty() {
        let option = argument.split(' ').next().unwrap_or_default();
        let remedy = listed.or_else(|| example(called?, option));
        return (format!("'{argument}' has no value"), remedy);
    }
    let near = nearest(value, known.split(", ")).map(did_you_mean);
    (format!("'{value}' for '{argument}'"), near.or(listed))
}

/// The command that is called, or the one below it.
fn called<'c>(command: &'c Command, words: &[String]) -> Option<&'c Command> {
    let below = |here: Option<&'c Command>, word: &String| {
        here.unwrap_or(command).find_subcommand(word).or(here)
    };
    words.iter().fold(None, below)
}

/// The first example of a command's help that has this text.
fn example(of: &Command, text: &str) -> Option<String> {
    let help = of.get_after_help()?.to_string();
    let mut lines = help.lines().filter_map(|line| line.strip_prefix("  "));
    let line = lines.find(|line| line.contains(text))?;
    // An explanation may follow.
    let command = line.split("   ").next().unwrap_or(line);
    Some(format!("for example `{command}`"))
}

/// The values that an argument takes, where they are few.
fn values(of: &Command, argument: &str) -> Option<String> {
    let mut all = of.get_arguments();
    let known = all
        .find(|one| one.to_string() == argument)?
        .get_possible_values();
    let names: Vec<_> = known.iter().map(|one| one.get_name()).collect();
    (!names.is_empty()).then(|| format!("give one of {}", names.join(", ")))
}

/// The remedy for a value of an argument that cannot be read, for this reason.
fn no_value(
    argument: &str,
    why: String,
    here: Option<&Command>,
    words: &[String],
) -> Option<String> {
    let option = argument.split(' ').next().unwrap_or_default();
    let place = words.iter().position(|word| word == option);
    if let Some(list) = place.and_then(|place| one_word(words, place)) {
        return Some(list);
    }
    if here.is_some_and(|here| takes_a_list(here, option)) {
        return Some(format!(
            "separate numbers by commas alone, as in {option}=20,-60,80"
        ));
    }
    let plain = NO_NUMBERS.iter().find(|(words, _)| *words == why);
    let range = why
        .split_once(" is not in ")
        .and_then(|(_, range)| range.split_once(".."));
    match (plain, range) {
        (Some((_, remedy)), _) => Some((*remedy).to_owned()),
        (None, Some((low, high))) => {
            let high = high.trim_start_matches('=');
            Some(format!("give a number from {low} to {high}"))
        }
        (None, None) => Some(why).filter(|why| !why.is_empty()),
    }
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
    if ["help", "version"].contains(&word) {
        return Some(did_you_mean(&format!("--{word}")));
    }
    let above = commands(command).find(|one| one.find_subcommand(word).is_some());
    if let Some(above) = above {
        return Some(did_you_mean(&format!("{} {word}", above.get_name())));
    }
    let names: Vec<_> = commands(command).map(Command::get_name).collect();
    nearest(word, names.into_iter()).map(did_you_mean)
}

/// Whether an option of a command takes a list of numbers, which may be negative.
fn takes_a_list(of: &Command, option: &str) -> bool {
    let mut all = of.get_arguments();
    all.any(|one| one.get_long() == option.strip_prefix("--") && one.is_allow_hyphen_values_set())
}

fn is_number(word: &str) -> bool {
    let mut parts = word.trim_matches(',').split(',');
    parts.all(|part| part.parse::<f64>().is_ok())
}

/// The remedy for an option at a place whose numbers are words of their own.
fn one_word(words: &[String], option: usize) -> Option<String> {
    let numbers = words[option + 1..]
        .iter()
        .take_while(|word| is_number(word));
    let numbers: Vec<_> = numbers.map(|word| word.trim_matches(',')).collect();
    let list = format!("{}={}", words[option], numbers.join(","));
    (numbers.len() > 1).then(|| format!("several numbers are one word, {list}"))
}

/// The remedy for an argument that a command does not take.
fn no_argument(argument: &str, here: &Command, all: &Command, words: &[String]) -> Option<String> {
    // Of a word such as `-60` it names the first letter.
    let place = words.iter().position(|word| word.starts_with(argument))?;
    let first = words[..place].iter().rposition(|word| !is_number(word));
    let list = first.filter(|first| takes_a_list(here, &words[*first]) && is_number(&words[place]));
    if let Some(first) = list {
        return one_word(words, first);
    }
    if let Some(option) = offering(here, argument) {
        return Some(did_you_mean(&option));
    }
    let [.., option, key] = &words[..place] else {
        return no_option_or_word(argument, here, all);
    };
    match option == "--set" && !key.contains('=') {
        true => Some(format!("a setting is one word, --set {key}={argument}")),
        false => no_option_or_word(argument, here, all),
    }
}

/// An option of a command that has this value: `--mode realtime` for `--realtime`.
fn offering(here: &Command, argument: &str) -> Option<String> {
    let bare = |word: &str| word.replace('-', "");
    let written = bare(argument);
    here.get_arguments().find_map(|one| {
        let values = one.get_possible_values();
        let value = values
            .iter()
            .find(|value| bare(value.get_name()) == written)?;
        Some(format!("--{} {}", one.get_long()?, value.get_name()))
    })
}

fn has(of: &Command, name: &str) -> bool {
    of.get_arguments().any(|one| one.get_long() == Some(name))
}

fn no_option_or_word(argument: &str, here: &Command, all: &Command) -> Option<String> {
    if let Some(option) = argument.strip_prefix("--") {
        return Some(no_option(option, here, all));
    }
    let own = options(here);
    if let Some(letter) = argument.strip_prefix('-') {
        let near = own.iter().find(|one| one.starts_with(letter));
        return near.map(|near| did_you_mean(&format!("--{near}")));
    }
    Some(match (here.get_name(), here.get_positionals().count()) {
        ("run", _) => "one scenario at a time; `armplane compare` takes several".to_owned(),
        (_, 0) if has(here, "robot") => format!("give an arm as --robot {argument}"),
        (_, 0) => "leave it out".to_owned(),
        (_, takes) if has(here, "robot") => {
            format!("it takes {takes}; an arm is given as --robot {argument}")
        }
        (_, takes) => format!("it takes {takes}; a name with spaces stands in quotes"),
    })
}

/// The options of a command that are its own.
fn options(here: &Command) -> Vec<&str> {
    let own = here.get_arguments().filter(|one| !one.is_hide_set());
    let all = own.filter_map(clap::Arg::get_long);
    all.filter(|name| !["help", "version", "json", "verbose"].contains(name))
        .collect()
}

/// The remedy for an option that a command does not have.
fn no_option(option: &str, here: &Command, all: &Command) -> String {
    if (here.get_name(), option) == ("run", "robot") {
        return "a scenario names its robot; `armplane new NAME --robot ROBOT` writes one"
            .to_owned();
    }
    let own = options(here);
    if let Some(near) = nearest(option, own.iter().copied()) {
        return did_you_mean(&format!("--{near}"));
    }
    let others = commands(all).filter(|one| has(one, option));
    let others: Vec<_> = others.map(Command::get_name).collect();
    match others.is_empty() {
        true if has(here, "set") => format!(
            "its options are --{}; a key of the scenario is given by --set KEY=VALUE",
            own.join(", --")
        ),
        true if own.is_empty() => "it has no options".to_owned(),
        true => format!("its options are --{}", own.join(", --")),
        false => format!(
            "it is an option of `armplane {}`",
            others.join("`, `armplane ")
        ),
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
            ("inspect --robot ur5 --q-deg 20 60 80", "--q-deg=20,60,80"),
            ("inspect --q-deg 20, 60, 80", "--q-deg=20,60,80"),
            ("inspect --robot ur5 --tip tool0", "`--frame`"),
            ("new", "`armplane new "),
            ("inspect --count 3", "`armplane compare`"),
            ("inspect ur5", "--robot ur5"),
            ("run --from a@1 --seed 2", "'--from"),
            ("run a.toml --realtime", "`--mode realtime`"),
            ("run a.toml --set control.k_p 900", "--set control.k_p=900"),
            ("run a.toml -o here", "`--out`"),
            ("export a csv", "`--format csv`"),
            ("inspect --q-deg [20,40]", "--q-deg=20,-60,80"),
            ("inspect --ee_link tool0", "--frame"),
            ("verify --runs 0", "from 1 to 1000"),
            ("generate schema", "scenario"),
            ("servo ur5 --random", "--random 7"),
            ("version", "`--version`"),
            ("completions", "`generate completions`"),
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
