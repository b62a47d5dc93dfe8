//! The whole thing on real processes and real shared memory, as a person would use it.

mod bad_input;
mod bench;
mod clients;
mod command;
mod compare;
mod corpus;
mod determinism;
mod exchange;
mod faults;
mod folders;
mod graph;
mod histories;
mod hostile;
mod inspect;
mod life;
mod neighbours;
mod patience;
mod properties;
mod recording;
mod replay;
mod run;
mod steady;
mod sweep;
mod top;
mod tutorial;
mod verify;
