//! `armplane`: one executable, many processes. The command line of a person, and that of the processes which the launcher starts.

fn main() -> std::process::ExitCode {
    cli::main()
}
