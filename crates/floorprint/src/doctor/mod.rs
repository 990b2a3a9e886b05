//! What is wrong with a recording, said before it becomes a wrong map.
//!
//! One kind of evidence a file: the scans' numbers, the stamps, and what the odometry states held against what the scans
//! themselves say of the motion. A healthy recording shows no symptom.

mod ego_motion;
mod motion;
mod scans;
mod stamps;
mod symptom;

pub use symptom::{Severity, Symptom};

use crate::config::Config;
use crate::frames::Frames;
use crate::sensors::Record;
use crate::slam::StepReport;

/// What the numbers and stamps of a recording say by themselves, the worst first; quick.
#[must_use]
pub fn examine_numbers(records: &[Record]) -> Vec<Symptom> {
    worst_first(scans::examine(records).into_iter().chain(stamps::examine(records)))
}

/// What a drive that was solved shows of its odometry, the worst first; quick.
#[must_use]
pub fn examine_solved(steps: &[StepReport], records: &[Record]) -> Vec<Symptom> {
    worst_first(motion::examine_solved(steps, records))
}

/// Everything that seems wrong with a recording, the worst first.
///
/// Scans are looked at one by one; of the motion, some hundred moments spread over the drive are looked at, however long it
/// is. The result is the same for any number of threads.
#[must_use]
pub fn examine(records: &[Record], config: &Config) -> Vec<Symptom> {
    let mut symptoms = examine_numbers(records);
    // Where no frames can be made, or the scans' numbers make no sense, nothing can be said of the motion.
    let is_readable = symptoms.iter().all(|symptom| symptom.severity() < Severity::Fatal);
    // Scans as they are: odometry that is wrong would bend them. And clocks as they are.
    let mut as_they_are = config.clone();
    (as_they_are.scan.deskew, as_they_are.odometry.learn_lag) = (false, false);
    if let (true, Ok(frames)) = (is_readable, Frames::new(records, &as_they_are)) {
        symptoms.extend(motion::examine(&frames, records, config));
    }
    worst_first(symptoms)
}

/// Of the same severity, what was found first comes first.
fn worst_first(symptoms: impl IntoIterator<Item = Symptom>) -> Vec<Symptom> {
    let mut symptoms: Vec<Symptom> = symptoms.into_iter().collect();
    symptoms.sort_by_key(|symptom| std::cmp::Reverse(symptom.severity()));
    symptoms
}
