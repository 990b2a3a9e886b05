//! The program `floorprint`.

use std::process::ExitCode;

fn main() -> ExitCode {
    floorprint_cli::run(&floorprint_cli::Program::itself()).into()
}
