//! How records come in on a live robot: late by a bit, mixed with those of other sensors, some of them never.

use crate::SensorId;
use crate::random::{Stage, generator};
use crate::sensors::{Record, Stream};
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How records come in.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Arrival {
    /// Each record comes up to so much later than its stamp says, seconds; a sensor's records stay in their order.
    pub jitter_s: f64,
    /// Share of the records that never come.
    pub dropped_share: f64,
    /// Share of the records that come twice.
    pub doubled_share: f64,
}

impl Arrival {
    /// The records in the order in which they come. The same seed gives the same order.
    #[must_use]
    pub fn of(&self, records: Vec<Record>, seed: u64) -> Vec<Record> {
        let mut random = generator(seed, Stage::Arrival, 0, 0);
        // By sensor: the latest stamp, and when its last record came.
        let mut sensors: Vec<((Stream, SensorId), f64, f64)> = Vec::new();
        let mut coming: Vec<(f64, Record)> = Vec::with_capacity(records.len());
        for record in records {
            let sensor = record.sensor();
            let position = sensors.iter().position(|(known, ..)| *known == sensor).unwrap_or_else(|| {
                sensors.push((sensor, f64::NEG_INFINITY, f64::NEG_INFINITY));
                sensors.len() - 1
            });
            let (_, stamp_s, comes_s) = &mut sensors[position];
            *stamp_s = stamp_s.max(record.stamp_s());
            *comes_s = comes_s.max(*stamp_s + self.jitter_s * random.random::<f64>());
            let draw: f64 = random.random();
            if draw < self.dropped_share {
                continue;
            }
            if draw > 1.0 - self.doubled_share {
                coming.push((*comes_s, record.clone()));
            }
            coming.push((*comes_s, record));
        }
        // Stable: what comes at the same time stays in order.
        coming.sort_by(|a, b| a.0.total_cmp(&b.0));
        coming.into_iter().map(|(_, record)| record).collect()
    }
}
