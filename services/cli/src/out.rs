//! Printing for people and pipes, without waiting for either.
//!
//! Whoever prints leaves a text in a bounded queue and goes on: a terminal that is stopped (Ctrl-S) or a pipe that nobody reads must not stop the thread that
//! mends deaths and answers Ctrl-C. A thread for each stream writes, in the order of the texts; one that is stuck holds the other up for a moment only.
//! Lines on standard error for which there is no room are dropped and counted, and the count is printed as soon as there is room.
//!
//! Text of other programs may be in all of it (their last words, names, reasons), and with it codes that a terminal obeys: control characters are left out, but
//! for the ends of lines and tabs. What this program paints it has cleaned before.

use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{ErrorKind, IsTerminal, Write, stderr, stdout};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use session::table::count;
use session::{Failure, run_text};
use shared_types::summary::{REACHED, Summary};
use textwrap::core::{Word, display_width};
use textwrap::{Options, WordSeparator, WrapAlgorithm};

/// Bytes that may wait for a reader of standard error ...
const MOST_TOLD: usize = 1 << 20;
/// ... and of standard output, whose texts are the results.
const MOST_SHOWN: usize = 64 << 20;
/// More than the sentence on dropped lines has; bytes.
const SENTENCE: usize = 100;
/// A reader that takes nothing for so long is stuck: the other stream goes on without it ...
const SLOW: Duration = Duration::from_millis(200);
/// ... and the program ends without it.
const STUCK: Duration = Duration::from_secs(1);
/// The longest that the end of the program waits for a reader that is slow.
const PATIENCE: Duration = Duration::from_secs(5);
/// Pause between two pictures of the status line.
const EVERY: Duration = Duration::from_millis(100);
/// Columns within which the text of a line may begin, after its label.
const LABEL: usize = 30;
/// A write is so short that each one shows whether the reader reads; bytes.
const PIECE: usize = 4096;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stream {
    Out,
    Err,
}

/// Whoever reads a stream.
struct Reader {
    /// Bytes that wait for it, those that are being written among them.
    bytes: usize,
    dropped: u64,
    /// Whose line is being written.
    writing: Option<String>,
    /// When that began, or the reader last took something of it.
    moved: Instant,
    is_gone: bool,
}

impl Reader {
    fn is_stuck(&self, limit: Duration) -> bool {
        self.writing.is_some() && self.moved.elapsed() > limit
    }

    /// Whether nothing is left to be read.
    fn is_idle(&self) -> bool {
        self.bytes == 0 && self.writing.is_none()
    }

    /// Whether it is idle, or has been waited for long enough.
    fn is_late(&self, began: Instant) -> bool {
        self.is_idle() || self.is_stuck(STUCK) || began.elapsed() > PATIENCE
    }
}

struct State {
    /// In their order.
    texts: VecDeque<(Stream, String)>,
    out: Reader,
    err: Reader,
    /// Lines on standard error that nobody has read, by the word before the first colon.
    lost: BTreeMap<String, u64>,
    /// The last line of a terminal, which is always the latest one.
    status: Option<String>,
    /// Standard error is a terminal ...
    has_status: bool,
    /// ... which shows an older status line ...
    is_stale: bool,
    /// ... or the latest one, which results on the same terminal remove first.
    is_drawn: bool,
    is_same: bool,
}

impl State {
    fn new(has_status: bool) -> Self {
        let reader = || Reader {
            bytes: 0,
            dropped: 0,
            writing: None,
            moved: Instant::now(),
            is_gone: false,
        };
        Self {
            texts: VecDeque::new(),
            out: reader(),
            err: reader(),
            lost: BTreeMap::new(),
            status: None,
            has_status,
            is_stale: false,
            is_drawn: false,
            is_same: has_status && stdout().is_terminal(),
        }
    }

    fn reader(&mut self, stream: Stream) -> &mut Reader {
        match stream {
            Stream::Out => &mut self.out,
            Stream::Err => &mut self.err,
        }
    }

    fn push(&mut self, stream: Stream, text: String) {
        let most = match stream {
            Stream::Out => MOST_SHOWN,
            Stream::Err => MOST_TOLD,
        };
        let reader = self.reader(stream);
        let is_full = reader.bytes > 0 && reader.bytes + text.len() > most;
        if reader.is_gone || is_full {
            reader.dropped += u64::from(is_full);
            match stream {
                Stream::Out if is_full => lose(stream, UNREAD),
                Stream::Out => {}
                Stream::Err => self.miss(speaker(&text)),
            }
            return;
        }
        reader.bytes += text.len();
        self.texts.push_back((stream, text));
        self.note_dropped(stream);
    }

    fn miss(&mut self, speaker: String) {
        *self.lost.entry(speaker).or_default() += 1;
    }

    /// Gives up what waits for a reader of standard error.
    fn give_up(&mut self) {
        for (stream, text) in std::mem::take(&mut self.texts) {
            if stream == Stream::Out {
                self.texts.push_back((stream, text));
            } else {
                self.err.bytes -= text.len();
                self.miss(speaker(&text));
            }
        }
        let writing = self.err.writing.clone();
        writing.into_iter().for_each(|speaker| self.miss(speaker));
    }

    /// Leaves a sentence about dropped lines, where there is room for it.
    fn note_dropped(&mut self, stream: Stream) {
        if self.err.bytes + SENTENCE > MOST_TOLD {
            return;
        }
        let dropped = std::mem::take(&mut self.reader(stream).dropped);
        if dropped > 0 {
            let sentence = format!(
                "armplane: {} dropped, because nobody read the output\n",
                count(dropped, "line")
            );
            self.push(Stream::Err, sentence);
        }
    }

    /// The next text of a stream, and its bytes: none where something older is under way in the other one, unless that is stuck.
    fn take(&mut self, stream: Stream) -> Option<(String, usize)> {
        let is_of = |text: &(Stream, String)| text.0 == stream;
        if !self.texts.iter().any(is_of) {
            self.note_dropped(stream);
        }
        let is_err = stream == Stream::Err;
        let other = if is_err { &self.out } else { &self.err };
        let goes_on = other.is_stuck(SLOW);
        // The status line goes before results come: it may be about to be removed.
        let is_busy = other.writing.is_some() || !is_err && self.is_stale;
        let mut places = self.texts.iter();
        let place = places.position(is_of);
        let place = place.filter(|place| goes_on || !is_busy && *place == 0);
        let text = place.and_then(|place| self.texts.remove(place));
        let is_status = is_err && std::mem::take(&mut self.is_stale);
        if text.is_none() && !is_status {
            return None;
        }
        let was_drawn = (is_err || self.is_same) && std::mem::take(&mut self.is_drawn);
        self.is_stale |= was_drawn && !is_err;
        let text = text.map_or_else(String::new, |text| text.1);
        let reader = self.reader(stream);
        (reader.writing, reader.moved) = (Some(speaker(&text)), Instant::now());
        let removed = if was_drawn { "\r\x1b[K" } else { "" };
        let mut whole = removed.to_owned() + &text;
        let is_shown = is_err && self.has_status && (was_drawn || is_status);
        if let Some(status) = self.status.as_ref().filter(|_| is_shown) {
            whole += &beginning(status, columns() - 1);
            self.is_drawn = true;
        }
        Some((whole, text.len()))
    }
}

static STATE: OnceLock<Mutex<State>> = OnceLock::new();
/// Why results are missing.
static LOST: OnceLock<String> = OnceLock::new();
const UNREAD: &str = "nobody reads standard output";

/// Whether standard output was closed before the program began; the standard library has put another file in its place since.
static IS_CLOSED: AtomicBool = AtomicBool::new(false);

#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

extern "C" fn look() {
    // SAFETY: nobody closes it meanwhile, for there is one thread.
    let out = unsafe { BorrowedFd::borrow_raw(1) };
    IS_CLOSED.store(rustix::io::fcntl_getfd(out).is_err(), Ordering::Relaxed);
}

/// Whether nothing more reaches the reader of standard output.
pub(crate) fn is_gone() -> bool {
    LOST.get().is_some() || STATE.get().is_some_and(|state| locked(state).out.is_gone)
}

fn lose(stream: Stream, reason: &str) {
    if stream == Stream::Out {
        LOST.get_or_init(|| reason.to_owned());
    }
}
static CHANGED: Condvar = Condvar::new();

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits for a change of the state, or [`EVERY`].
fn changed(state: MutexGuard<'_, State>) -> MutexGuard<'_, State> {
    let woken = CHANGED.wait_timeout(state, EVERY);
    woken.unwrap_or_else(PoisonError::into_inner).0
}

/// Whether colours may be written there.
pub(crate) fn is_coloured(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Starts the threads that print; without them, in the processes of a run and where there can be no threads, whoever prints writes.
pub(crate) fn start() {
    let streams = [
        (Stream::Out, direct(&stdout())),
        (Stream::Err, direct(&stderr())),
    ];
    for (stream, to) in streams {
        let Ok(to) = to else { return };
        let thread = std::thread::Builder::new()
            .name("printer".into())
            .stack_size(128 << 10);
        let is_started = thread.spawn(move || print(STATE.wait(), stream, to));
        if is_started.is_err() {
            return;
        }
    }
    let _ = STATE.set(Mutex::new(State::new(stderr().is_terminal())));
}

/// A stream of this process as a file: the standard library's own streams hide that one cannot be read or written to.
pub(crate) fn direct(stream: &impl AsFd) -> std::io::Result<File> {
    Ok(stream.as_fd().try_clone_to_owned()?.into())
}

/// Writes what comes for a stream, until the program ends.
fn print(shared: &Mutex<State>, stream: Stream, mut to: File) {
    let mut state = locked(shared);
    loop {
        let Some((mut whole, bytes)) = state.take(stream) else {
            // Changes of a status line wake nobody.
            state = changed(state);
            continue;
        };
        drop(state);
        if is_raw() {
            whole = whole.replace('\n', "\r\n");
        }
        let is_written = write_whole(stream, &whole, &mut to, || {
            locked(shared).reader(stream).moved = Instant::now();
        });
        state = locked(shared);
        if !is_written && stream == Stream::Err {
            state.give_up();
        }
        let reader = state.reader(stream);
        reader.writing = None;
        reader.bytes -= bytes;
        if !is_written {
            (reader.is_gone, reader.bytes) = (true, 0);
            state.texts.retain(|text| text.0 != stream);
        }
        CHANGED.notify_all();
    }
}

/// Whether a text could be written; `moved` is called whenever the reader has taken a piece.
fn write_whole(stream: Stream, text: &str, to: &mut impl Write, moved: impl Fn()) -> bool {
    let mut rest = text.as_bytes();
    let written = loop {
        if rest.is_empty() {
            break to.flush();
        }
        match to.write(&rest[..rest.len().min(PIECE)]) {
            Ok(0) => break Err(ErrorKind::WriteZero.into()),
            Ok(bytes) => {
                rest = &rest[bytes..];
                moved();
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            // Another program has made the terminal's end of all of us non-blocking.
            Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(EVERY / 10),
            Err(error) => break Err(error),
        }
    };
    // A reader that has gone away (`armplane run | head`) is no error.
    if let Err(error) = &written
        && error.kind() != ErrorKind::BrokenPipe
    {
        lose(
            stream,
            &format!("standard output cannot be written: {error}"),
        );
    }
    written.is_ok()
}

/// Gives the readers a short time for what is left; why results have been lost, if they have. A reader of results that stand nowhere else, which is not
/// `is_bounded`, may take its time: nothing runs any more, and Ctrl-C ends the program.
pub(crate) fn finish(is_bounded: bool) -> Option<&'static str> {
    let Some(shared) = STATE.get() else {
        return LOST.get().map(String::as_str);
    };
    set_status(None);
    let began = Instant::now();
    let mut state = locked(shared);
    loop {
        let is_idle = state.out.is_idle();
        let is_shown = is_idle || is_bounded && state.out.is_late(began);
        let is_told = state.err.is_late(began) && (!state.is_stale || state.err.is_stuck(STUCK));
        if is_shown && is_told {
            let left = (!is_idle).then_some(UNREAD);
            return LOST.get().map(String::as_str).or(left);
        }
        state = changed(state);
    }
}

/// Lines on standard error that nobody has read, by the word before the first colon; what nobody reads in a short time is given up.
pub(crate) fn unread() -> BTreeMap<String, u64> {
    let Some(shared) = STATE.get() else {
        return BTreeMap::new();
    };
    let (began, mut state) = (Instant::now(), locked(shared));
    while !state.err.is_late(began) {
        state = changed(state);
    }
    state.give_up();
    std::mem::take(&mut state.lost)
}

fn speaker(text: &str) -> String {
    let speaker = text.split_once(": ").map_or("", |(speaker, _)| speaker);
    speaker.to_owned()
}

fn push(stream: Stream, text: &str) {
    if stream == Stream::Out && IS_CLOSED.load(Ordering::Relaxed) {
        return lose(stream, "standard output is closed");
    }
    if let Some(state) = STATE.get() {
        locked(state).push(stream, text.to_owned());
        CHANGED.notify_all();
        return;
    }
    match stream {
        Stream::Out => write_whole(stream, text, &mut stdout(), || {}),
        Stream::Err => write_whole(stream, text, &mut stderr(), || {}),
    };
}

/// Changes the last line of a terminal.
pub(crate) fn set_status(line: Option<String>) {
    if let Some(state) = STATE.get() {
        let mut state = locked(state);
        let is_over = line.is_none();
        // Whoever removes it a second time leaves the first removal to be done.
        let is_new = !(is_over && state.status.is_none());
        state.is_stale = state.has_status && !state.err.is_gone && (state.is_stale || is_new);
        state.status = line.map(|line| plain(&line));
        if is_over {
            CHANGED.notify_all();
        }
    }
}

/// `println!`, into the queue.
macro_rules! say {
    ($($text:tt)*) => {{
        $crate::out::show(&format_args!("{}\n", format_args!($($text)*)));
    }};
}
pub(crate) use say;

/// Prints what serialises, over several lines.
pub(crate) fn say_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    say!(
        "{}",
        serde_json::to_string_pretty(value).map_err(Failure::work)?
    );
    Ok(())
}

/// Prints a result, for machines or for people.
pub(crate) fn answer(as_json: bool, json: &impl serde::Serialize, text: &impl std::fmt::Display) {
    if as_json {
        say!("{}", serde_json::json!(json));
    } else {
        show(text);
    }
}

/// The verdict of a command whose results are whole, or its failure for what they lack.
pub(crate) fn whole(lack: Option<String>) -> Result<bool, Failure> {
    lack.map_or(Ok(true), |lack| Err(Failure::Work(lack)))
}

/// Prints what ends its own lines.
pub(crate) fn show(text: &impl std::fmt::Display) {
    push(Stream::Out, &wrapped(&plain(&text.to_string()), &stdout()));
}

/// How a run's results are printed.
#[derive(Clone, Copy)]
pub(crate) enum Form {
    Json,
    Short,
    /// Also what few people look for.
    Long,
}

/// Prints the results of a run, its verdict last.
pub(crate) fn show_run(summary: &Summary, folder: &Path, form: Form) -> Result<(), Failure> {
    if matches!(form, Form::Json) {
        return say_json(summary);
    }
    show(&run_text(summary, folder, matches!(form, Form::Long)));
    let verdict = session::verdict(summary) + "\n";
    let verdict = wrapped(&plain(&verdict), &stdout()).into_owned();
    let colour = match summary.outcome.as_str() {
        REACHED => "32",
        _ if summary.is_success() => "33",
        _ => "31",
    };
    match is_coloured(&stdout()) {
        true => show_painted(&format_args!("\x1b[1;{colour}m{verdict}\x1b[m")),
        false => push(Stream::Out, &verdict),
    }
    Ok(())
}

/// The same of a text that this program has painted, or that is none for people: as it is.
pub(crate) fn show_painted(text: &impl std::fmt::Display) {
    push(Stream::Out, &text.to_string());
}

/// Prints a line on standard error.
pub(crate) fn tell(line: &impl std::fmt::Display) {
    push(
        Stream::Err,
        &wrapped(&plain(&format!("{line}\n")), &stderr()),
    );
}

/// The same of a line that is painted.
pub(crate) fn tell_painted(line: &impl std::fmt::Display) {
    push(Stream::Err, &format!("{line}\n"));
}

/// Columns of the terminal.
pub(crate) fn columns() -> usize {
    size().0
}

/// Columns and rows of the terminal; 80 and 24 where there is none.
pub(crate) fn size() -> (usize, usize) {
    let size = [stdout().as_fd(), stderr().as_fd()]
        .into_iter()
        .find_map(|stream| rustix::termios::tcgetwinsize(stream).ok());
    size.filter(|size| size.ws_col > 1 && size.ws_row > 0)
        .map_or((80, 24), |size| (size.ws_col.into(), size.ws_row.into()))
}

/// Words between blanks; a command in backticks is one, so that it can be copied.
fn words(line: &str) -> Box<dyn Iterator<Item = Word<'_>> + '_> {
    let (mut is_command, mut was_blank) = (false, false);
    let ends = line.char_indices().filter_map(move |(at, letter)| {
        is_command ^= letter == '`';
        let is_end = was_blank && letter != ' ';
        was_blank = letter == ' ' && !is_command;
        is_end.then_some(at)
    });
    let mut begin = 0;
    let ends = ends.chain([line.len()]);
    Box::new(ends.map(move |end| Word::from(&line[std::mem::replace(&mut begin, end)..end])))
}

/// Whether the arguments ask for JSON, before they are parsed, or where they cannot be.
pub(crate) fn wants_json() -> bool {
    std::env::args_os().any(|argument| argument == "--json")
}

/// A text for people in lines that fit their terminal, where they have one; a line goes on under the place where its text begins.
fn wrapped<'a>(text: &'a str, to: &impl IsTerminal) -> Cow<'a, str> {
    if !to.is_terminal() || wants_json() {
        return Cow::Borrowed(text);
    }
    let columns = columns();
    let line = |line: &'a str| {
        let blanks = |at: &usize| line[..*at].ends_with("  ") && !line[*at..].starts_with(' ');
        let begins = line
            .char_indices()
            .map(|(at, _)| at)
            .take(LABEL)
            .filter(blanks);
        let indent = " ".repeat(begins.last().map_or(0, |at| display_width(&line[..at])));
        match display_width(line) <= columns {
            true => line.to_owned(),
            false => textwrap::fill(line, folded(columns).subsequent_indent(&indent)),
        }
    };
    Cow::Owned(text.split('\n').map(line).collect::<Vec<_>>().join("\n"))
}

fn folded(columns: usize) -> Options<'static> {
    Options::new(columns)
        .break_words(false)
        .word_separator(WordSeparator::Custom(words))
        .word_splitter(textwrap::WordSplitter::NoHyphenation)
        .wrap_algorithm(WrapAlgorithm::FirstFit)
}

/// As many words of a line as so many columns have room for.
fn beginning(line: &str, columns: usize) -> String {
    let mut lines = textwrap::wrap(line, folded(columns)).into_iter();
    let first = lines.next().unwrap_or_default().into_owned();
    match lines.next() {
        None => first,
        Some(_) => textwrap::wrap(&first, folded(columns - 2))[0].to_string() + " …",
    }
}

/// Whether the terminal begins no line by itself, because a command reads its keys one by one.
fn is_raw() -> bool {
    crossterm::terminal::is_raw_mode_enabled().unwrap_or_default()
}

/// Takes the log of this program, whose printer escapes codes in the text of others.
pub(crate) struct Log;

impl Write for Log {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        push(Stream::Err, &String::from_utf8_lossy(line));
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A text without control characters, but for the ends of lines and tabs, and without marks of direction.
pub(crate) fn plain(text: &str) -> String {
    // Marks of direction show a text in another order than it has.
    let is_mark = |letter| matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let is_code = |letter: char| letter.is_control() && !matches!(letter, '\n' | '\t');
    let is_kept = |letter: &char| !is_code(*letter) && !is_mark(*letter);
    text.chars().filter(is_kept).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_keep_their_order_and_lines_without_room_are_counted() {
        let mut state = State::new(false);
        state.push(Stream::Err, "first".to_owned());
        state.push(Stream::Out, "result".to_owned());
        assert!(
            state.take(Stream::Out).is_none(),
            "an older line is to be written"
        );
        let line = "x".repeat(MOST_TOLD / 4);
        for _ in 0..10 {
            state.push(Stream::Err, line.clone());
        }
        let mut written = Vec::new();
        while let Some((text, bytes)) = state.take(Stream::Err) {
            state.err.bytes -= bytes;
            state.err.writing = None;
            written.push(text);
            if written.len() == 1 {
                let result = state.take(Stream::Out).map(|one| one.0);
                assert_eq!(result.as_deref(), Some("result"));
                state.out.writing = None;
            }
        }
        assert_eq!(
            written.len(),
            5,
            "the first, three with room, and a sentence"
        );
        assert!(written[4].contains(" 7 lines dropped"), "{}", written[4]);
        assert_eq!(state.lost.values().sum::<u64>(), 7);
    }

    #[test]
    fn results_remove_the_status_line_and_it_is_drawn_again_below_them() {
        let mut state = State::new(true);
        (state.is_same, state.is_drawn) = (true, true);
        state.status = Some("bar".to_owned());
        state.push(Stream::Out, "result".to_owned());
        let taken = state.take(Stream::Out).map(|one| one.0);
        assert_eq!(taken.as_deref(), Some("\r\x1b[Kresult"));
        state.out.writing = None;
        let redrawn = state.take(Stream::Err).map(|one| one.0);
        assert_eq!(redrawn.as_deref(), Some("bar"));
    }

    #[test]
    fn no_code_that_a_terminal_obeys_is_left() {
        let hostile =
            "a\x1b]0;title\x07\x1b[2Jb\u{9b}31m\x7f\r\tend\n\x1b[1;31mred\x1b[0m\x1b[\x1b[3";
        assert_eq!(plain(hostile), "a]0;title[2Jb31m\tend\n[1;31mred[0m[[3");
    }
}
