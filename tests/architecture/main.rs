//! The rules of the house, checked on the source itself: what a crate may import, what pure code may touch, circles of files, citations, and
//! that each test claims something, and that each guarantee names one.

mod calls;
mod circles;
mod citations;
mod claims;
mod guarantees;
mod pure_files;
mod purity;
mod repairs;
mod rules;
mod source;
mod syntax;
mod tokens;
