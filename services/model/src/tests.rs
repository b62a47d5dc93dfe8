//! Golden data, algorithms that check each other, and what is refused.

mod golden;
mod identities;
mod loading;
