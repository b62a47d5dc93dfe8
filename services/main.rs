//! `armplane`: one executable, many processes. What a person types, and what the launcher types for the processes it starts.
#![allow(non_snake_case)]

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
