//! Golden data, and algorithms that check each other.

mod golden;
