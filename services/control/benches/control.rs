//! What a tick costs: analyzer and controller, PUMA 560. `cargo bench -p control`

fn main() {
    divan::main();
}
