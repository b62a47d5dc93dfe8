//! Golden data, algorithms that check each other, and refusals.

mod golden;
mod identities;
mod loading;
