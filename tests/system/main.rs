//! The whole thing on real processes and real shared memory, as a person would use it.

mod command;
mod corpus;
mod cuts;
mod damage;
mod faults;
mod franka;
mod hostile;
mod outputs;
mod paths;
mod patience;
mod properties;
mod steady;
mod terminals;
mod transcripts;
mod tutorial;
