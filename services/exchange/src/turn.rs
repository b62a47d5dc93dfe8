//! One tick of a process with an exchange page, by its role: writes inputs to the page, asks the
//! program, sends its outputs.

use std::mem::offset_of;
use std::time::Duration;

use runtime::{Shell, StateCell};
use shared_types::codes::{REQUEST_TICK, USE_FEEDBACK, USE_READS, USE_WRITES};
use shared_types::layout::MessageLayout;
use shared_types::task_end::TaskEnd;
use shared_types::{Message, TorqueCommand};

use crate::ended::Ended;
use crate::failure::Failure;
use crate::ports::{self, End, Gathered, Input, Output};
use crate::program::Program;
use crate::reply::{self, Answer};

/// How often an observer looks for messages.
const ROUND: Duration = Duration::from_millis(10);

/// Most messages of one topic that wait for those of the others. Beyond it, an observer sees
/// incomplete ticks.
const MOST_WAITING: usize = 4096;

type Topics<'a> = &'a [(MessageLayout, u32)];

/// The topics of one use, each with its place on the page.
fn of_use(topics: Topics<'_>, usage: u32) -> impl Iterator<Item = (usize, &str)> {
    topics
        .iter()
        .enumerate()
        .filter(move |(_, (_, used))| *used == usage)
        .map(|(place, (layout, _))| (place, layout.topic.as_str()))
}

/// The ends of the topics of one use.
fn ends<E: End + ?Sized>(
    shell: &Shell,
    topics: Topics<'_>,
    usage: u32,
) -> Result<Vec<Box<E>>, Ended> {
    of_use(topics, usage)
        .map(|(place, topic)| Ok(ports::open(shell, topic, place)?))
        .collect()
}

/// Asks the program once, and checks its whole answer before the caller sends the first message.
fn step(
    program: &mut Program<'_>,
    outputs: &mut [Box<dyn Output>],
    tick: u64,
) -> Result<Answer, Ended> {
    let answer = program.ask(REQUEST_TICK, tick).map_err(Ended::Theirs)?;
    if answer != Answer::Stopped
        && let Some((topic, field)) = outputs
            .iter_mut()
            .find_map(|output| output.not_finite(&program.page))
    {
        return Err(Ended::Theirs(Failure::NotFinite { tick, topic, field }));
    }
    Ok(answer)
}

/// Makes the ticks: the program moves the arm to the tick under the torque of the tick before, and reads its sensors.
///
/// It is asked as soon as that torque is there, before the tick is due: the time it takes does not delay the samples.
pub(crate) fn world(
    shell: &Shell,
    topics: Topics<'_>,
    program: &mut Program<'_>,
    length: u64,
) -> Result<(), Ended> {
    let mut inputs = ends::<dyn Input>(shell, topics, USE_FEEDBACK)?;
    let mut outputs = ends::<dyn Output>(shell, topics, USE_WRITES)?;
    let torque = of_use(topics, USE_FEEDBACK)
        .find(|(_, topic)| *topic == TorqueCommand::TOPIC)
        .map(|(place, _)| place);
    let mut end = TaskEnd::new(
        shell.manifest().rate_hz,
        u64::from(TaskEnd::LONGEST).saturating_mul(length),
    );
    let mut source = shell.tick_source(0);
    let mut answer = step(program, &mut outputs, 0)?;
    while answer != Answer::Stopped
        && let Some(tick) = source.next()?
    {
        for output in &mut outputs {
            output.send(tick)?;
        }
        for input in &mut inputs {
            input.arriving(&program.page, tick, source.deadline_ns())?;
        }
        end.take(torque.map(|place| program.page.number(place, offset_of!(TorqueCommand, phase))));
        if answer == Answer::Over || end.is_over(tick + 1) {
            source.finish()?;
            break;
        }
        answer = step(program, &mut outputs, tick + 1)?;
    }
    Ok(())
}

/// Answers each tick.
pub(crate) fn stage(
    shell: &Shell,
    topics: Topics<'_>,
    program: &mut Program<'_>,
    state: &mut StateCell,
) -> Result<(), Ended> {
    let mut inputs = ends::<dyn Input>(shell, topics, USE_READS)?;
    let mut outputs = ends::<dyn Output>(shell, topics, USE_WRITES)?;
    // The graph lists a process's inputs in the order of the data: the last one comes last.
    let Some(mut last) = inputs.pop() else {
        return Ok(());
    };
    'ticks: while let Some(tick) = last.next(&program.page)? {
        for input in &mut inputs {
            if !input.at(&program.page, tick)? {
                continue 'ticks;
            }
        }
        if step(program, &mut outputs, tick)? == Answer::Stopped {
            break;
        }
        let bytes = reply::state_bytes(&program.page, tick).map_err(Ended::Theirs)?;
        if bytes > 0 {
            let mut saved = vec![0; bytes];
            program.page.get_state(&mut saved);
            // The page has room for no more than the cell.
            state.write(&saved);
        }
        for output in &mut outputs {
            output.send(tick)?;
        }
    }
    Ok(())
}

/// Shows every tick, when the messages of all topics have come.
pub(crate) fn observer(
    shell: &Shell,
    topics: Topics<'_>,
    program: &mut Program<'_>,
) -> Result<(), Ended> {
    let mut gathered = ends::<dyn Gathered>(shell, topics, USE_READS)?;
    while shell.poll(ROUND)? {
        for topic in &mut gathered {
            topic.collect()?;
        }
        let is_whole = |gathered: &[Box<dyn Gathered>]| {
            gathered.iter().all(|topic| topic.oldest().is_some())
                || gathered.iter().any(|topic| {
                    topic
                        .oldest()
                        .is_some_and(|(_, waiting)| waiting > MOST_WAITING)
                })
        };
        while is_whole(&gathered) {
            if !show_oldest(program, &mut gathered)? {
                return Ok(());
            }
        }
    }
    while show_oldest(program, &mut gathered)? {}
    Ok(())
}

/// Shows the oldest tick. `false` if there is none, or if the program is no longer waited for.
fn show_oldest(
    program: &mut Program<'_>,
    gathered: &mut [Box<dyn Gathered>],
) -> Result<bool, Ended> {
    let Some(tick) = gathered
        .iter()
        .filter_map(|topic| topic.oldest())
        .map(|(tick, _)| tick)
        .min()
    else {
        return Ok(false);
    };
    for topic in gathered.iter_mut() {
        topic.show(&program.page, tick);
    }
    Ok(step(program, &mut [], tick)? != Answer::Stopped)
}
