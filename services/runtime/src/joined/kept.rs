//! All that a program in another language goes on from: its own state, and what is kept for it between two ticks.

use super::ports::{Input, Output};

/// Bytes that say how many follow.
const LENGTH: usize = size_of::<u64>();

/// Bytes that [`write`] needs at most, beside the program's own state.
pub(super) fn most(inputs: &[Input], outputs: &[Output]) -> usize {
    let inputs = inputs.iter().map(|input| input.layout().bytes + 1);
    let outputs = outputs.iter().map(|output| output.layout().bytes);
    let parts = inputs.chain(outputs).map(|bytes| bytes + LENGTH);
    parts.sum::<usize>() + 2 * LENGTH
}

/// Appends the state of a program and what its topics hold. `end`: the phase of the task and the ticks since a refusal.
pub(super) fn write(
    out: &mut Vec<u8>,
    end: (u32, u64),
    inputs: &[Input],
    outputs: &[Output],
    state: &[u8],
) {
    let mut put = |bytes: &[u8]| {
        out.extend_from_slice(&(bytes.len() as u64).to_ne_bytes());
        out.extend_from_slice(bytes);
    };
    outputs.iter().for_each(|output| put(output.last()));
    for input in inputs {
        put(&[u8::from(input.is_fresh())]);
        put(input.last().unwrap_or_default());
    }
    out.extend_from_slice(&u64::from(end.0).to_ne_bytes());
    out.extend_from_slice(&end.1.to_ne_bytes());
    out.extend_from_slice(state);
}

/// Takes up what [`write`] has written: the end of the task, and the program's own state. `None` of other bytes, or other topics.
pub(super) fn read(
    mut from: &[u8],
    inputs: &mut [Input],
    outputs: &mut [Output],
) -> Option<((u32, u64), Vec<u8>)> {
    let number = |from: &mut &[u8]| {
        let (number, rest) = from.split_first_chunk()?;
        *from = rest;
        Some(u64::from_ne_bytes(*number))
    };
    let part = |from: &mut &[u8]| {
        let length = usize::try_from(number(from)?).ok()?;
        let (part, rest) = from.split_at_checked(length)?;
        *from = rest;
        Some(part.to_vec())
    };
    for output in outputs {
        output.resume(&part(&mut from)?)?;
    }
    for input in inputs {
        let is_fresh = part(&mut from)? == [1];
        input.resume(&part(&mut from)?, is_fresh)?;
    }
    let phase = u32::try_from(number(&mut from)?).ok()?;
    Some(((phase, number(&mut from)?), from.to_vec()))
}
