//! `floorprint optimize`: the best estimate of a pose graph in a g2o file.

use crate::outcome::Outcome;
use crate::summary::counted;
use crate::terminal::Terminal;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use floorprint::pose_graph::{Optimizer, OptimizerConfig, RobustKernel};
use floorprint_io::{read_g2o, write_g2o};
use std::path::PathBuf;
use std::time::Instant;

/// Solve a pose graph in a g2o file (VERTEX_SE2, EDGE_SE2, EDGE_PRIOR_SE2, FIX), such as a run's graph.g2o.
///
/// Vertices keep their ids, and what is fixed stays where it is.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Graph to read.
    #[arg(value_name = "FILE")]
    graph: PathBuf,
    /// Where to write it with its best estimates.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How edges that fit badly are judged; edges between vertices whose ids follow each other are always
    /// trusted.
    #[arg(long, value_enum, default_value = "none")]
    robust: Robust,
    /// Largest number of steps.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
}

/// How edges that fit badly are judged.
#[derive(Clone, Copy, ValueEnum)]
enum Robust {
    /// Every edge is trusted.
    None,
    /// Dynamic covariance scaling (Agarwal et al. 2013), Φ = 5.
    Dcs,
    /// Cauchy's kernel, three standard deviations wide.
    Cauchy,
}

/// Runs `floorprint optimize`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let mut file = read_g2o(&arguments.graph)?;
    let graph = &mut file.graph;
    let kernel = match arguments.robust {
        Robust::None => RobustKernel::Quadratic,
        Robust::Dcs => RobustKernel::DynamicCovarianceScaling { phi: 5.0 },
        Robust::Cauchy => RobustKernel::Cauchy { scale: 3.0 },
    };
    for factor in 0..graph.between_factors().len() {
        let edge = &graph.between_factors()[factor];
        if edge.from.abs_diff(edge.to) > 1 {
            graph.set_kernel(factor, kernel);
        }
    }
    let config = OptimizerConfig { max_iterations: arguments.iterations as usize, ..OptimizerConfig::default() };
    let started = Instant::now();
    let report = Optimizer::new(config)
        .optimize(graph)
        .with_context(|| format!("cannot solve {}", arguments.graph.display()))?;
    let took_s = started.elapsed().as_secs_f64();
    write_g2o(&arguments.out, &file)?;
    let vertices = file.graph.poses().len();
    terminal.say(&format!(
        "{} {}, {}: cost {:.6e} -> {:.6e} in {} and {took_s:.3} s{}; written to {}",
        vertices,
        if vertices == 1 { "vertex" } else { "vertices" },
        counted(file.graph.between_factors().len(), "edge"),
        report.initial_cost,
        report.final_cost,
        counted(report.iterations, "step"),
        if report.converged { "" } else { ", not converged: allow more --iterations" },
        arguments.out.display(),
    ));
    Ok(Outcome::Fine)
}
