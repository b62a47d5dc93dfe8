//! `armplane`: one executable, many processes. What a person types, and what the launcher types for the processes it starts.

fn main() -> std::process::ExitCode {
    cli::main()
}
