//! The package for Python: built, installed into an environment of its own below the target folder, and checked there
//! with Python's own tools. Where there is no Python, or no package index, it says so and skips.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread;

/// What the check needs besides the package: tools, and what the package works with.
const TOOLS: &[&str] = &[
    "maturin>=1.16,<2",
    "pip",
    "numpy>=1.24",
    "scipy",
    "matplotlib",
    "pytest>=8",
    "mypy>=1.15",
    "ruff>=0.12",
    "tqdm>=4.60",
    "pandas>=2",
    "pyarrow>=14",
    "ray>=2.40",
    "fsspec>=2023.12",
    "s3fs",
    "moto[s3]>=5",
    "flask",
    "flask-cors",
    "jupytext>=1.16",
    "nbclient>=0.10",
    "ipykernel",
];
/// Of evo the errors count; plots and bags would bring a hundred megabytes along.
const WITHOUT_DEPENDENCIES: &str = "evo>=1.30";

struct Environment {
    folder: PathBuf,
    package: PathBuf,
}

impl Environment {
    /// An environment with the tools; the reason why there can be none.
    fn with_tools() -> Result<Self, String> {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python");
        let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../floorprint-python").canonicalize().unwrap();
        let environment = Self { folder, package };
        let installed = environment.folder.join("tools.txt");
        let wanted = [TOOLS, &[WITHOUT_DEPENDENCIES]].concat().join("\n");
        if fs::read_to_string(&installed).is_ok_and(|found| found == wanted) {
            return Ok(environment);
        }
        let is_recent = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))";
        let python = Command::new("python3").args(["-c", is_recent]).output();
        if !python.is_ok_and(|output| output.status.success()) {
            return Err("there is no python3 of version 3.10 or later with venv".to_owned());
        }
        let _ = fs::remove_dir_all(&environment.folder);
        let made = Command::new("python3").args(["-m", "venv"]).arg(&environment.folder).output().unwrap();
        assert!(made.status.success(), "{}", said(&made));
        for tools in [TOOLS, &["--no-deps", WITHOUT_DEPENDENCIES]] {
            environment.install(tools)?;
        }
        fs::write(installed, wanted).unwrap();
        Ok(environment)
    }

    /// Installs packages: with uv, in a small part of pip's time, else with pip, which knows how its user reaches the
    /// index. The reason why they cannot be had.
    fn install(&self, packages: &[&str]) -> Result<(), String> {
        if self.passes("pip", &["install", "--quiet", "--no-compile", "--retries=1", "uv"]).is_ok()
            && self.passes("uv", &[&["pip", "install", "--quiet"], packages].concat()).is_ok()
        {
            return Ok(());
        }
        let text =
            match self.passes("pip", &[&["install", "--quiet", "--no-compile", "--retries=1"], packages].concat()) {
                Ok(()) => return Ok(()),
                Err(text) => text,
            };
        let unreachable = ["connection", "Connection", "resolve", "timed out", "No matching distribution"];
        assert!(unreachable.iter().any(|sign| text.contains(sign)), "{text}");
        let first = text.lines().nth(1).unwrap_or_default();
        Err(format!("the package index cannot be reached: {first}"))
    }

    /// A program of the environment, to be run in the package's folder.
    fn command(&self, program: &str) -> Command {
        let binaries = self.folder.join("bin");
        let mut command = Command::new(binaries.join(program));
        let path = std::env::var_os("PATH").unwrap_or_default();
        let paths = std::iter::once(binaries).chain(std::env::split_paths(&path));
        command
            .current_dir(&self.package)
            .env("PATH", std::env::join_paths(paths).unwrap())
            .env("VIRTUAL_ENV", &self.folder)
            // Compiled once, where it is imported, and not beside the sources.
            .env("PYTHONPYCACHEPREFIX", self.folder.join("compiled"))
            .env("PIP_DISABLE_PIP_VERSION_CHECK", "1")
            .env("FLOORPRINT_PROGRAM", env!("CARGO_BIN_EXE_floorprint"))
            .env("MPLBACKEND", "agg");
        command
    }

    /// Runs a program; gives what it says if it fails.
    fn passes(&self, program: &str, arguments: &[&str]) -> Result<(), String> {
        let output = self.command(program).args(arguments).output().unwrap();
        if output.status.success() {
            return Ok(());
        }
        Err(format!("{program} {}:\n{}", arguments.join(" "), said(&output)))
    }
}

fn said(output: &Output) -> String {
    [&output.stderr, &output.stdout].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).join("\n")
}

#[test]
fn the_package_for_python_is_built_and_checked() {
    let environment = match Environment::with_tools() {
        Ok(environment) => environment,
        Err(reason) => return eprintln!("SKIPPED: the package for Python is not checked: {reason}"),
    };
    // The same profile and folder as the tests' own.
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let install = environment
        .command("pip")
        .args(["install", "--quiet", "--no-build-isolation", "--no-deps", "--force-reinstall", "."])
        .env("MATURIN_PEP517_ARGS", "--profile dev --locked")
        .env("CARGO_TARGET_DIR", target)
        .output()
        .unwrap();
    assert!(install.status.success(), "the package cannot be built:\n{}", said(&install));

    let cache = environment.folder.join("mypy").display().to_string();
    let failures: Vec<String> = thread::scope(|scope| {
        let checks: [(&str, Vec<&str>); 4] = [
            ("ruff", vec!["check", "--no-cache", "."]),
            ("ruff", vec!["format", "--no-cache", "--check", "."]),
            ("mypy", vec!["--cache-dir", &cache]),
            ("pytest", vec!["-q", "-p", "no:cacheprovider"]),
        ];
        let running = checks.map(|(program, arguments)| {
            let environment = &environment;
            scope.spawn(move || environment.passes(program, &arguments))
        });
        running.into_iter().filter_map(|check| check.join().unwrap().err()).collect()
    });
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}
