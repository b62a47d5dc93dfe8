//! The whole thing on real processes and real shared memory, as a person would use it; and the rules that hold the house up.

mod bad_input;
mod bench;
mod command;
mod determinism;
mod inspect;
mod life;
mod paper;
mod recording;
mod replay;
mod run;
mod structure;
mod top;
mod verify;
