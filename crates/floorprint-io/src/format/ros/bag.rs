//! The second pass over a recording: from the messages that play a role to records.

use super::images::RecordedImages;
use super::record_maker::RecordMaker;
use super::recording::Recording;
use super::roles::{Roles, Unfulfilled};
use super::survey::{Survey, Topic};
use super::{FORMAT, MessageSource as _, live};
use crate::data_set::{
    BagContents, DataSet, DropReason, OpenOptions, RecordedTruth, RoleChoice, TopicChoice, TopicSummary,
};
use crate::error::{Problem, ReadError};
use crate::format::Format;
use crate::images::ImageIndex;
use crate::source::Source;
use floorprint::sensors::{LidarConfig, RobotConfig, StampAt, StampedPose};
use std::path::Path;

/// Reads a recording.
pub(super) fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let path = source.path();
    let recording = Recording::open(source)?;
    // The hash needs a pass of its own, beside the first one.
    let (hash, (mut survey, damage)) = std::thread::scope(|scope| {
        let hash = scope.spawn(|| recording.hash());
        let mut messages = recording.messages();
        let survey = Survey::of(&mut messages);
        (hash.join(), (survey, messages.damage()))
    });
    let input_hash = match hash {
        Ok(hash) => hash.map_err(|error| ReadError::io(path, &error))?,
        Err(panic) => std::panic::resume_unwind(panic),
    };
    if survey.topics.is_empty() {
        let found =
            damage.map_or("it holds no message".to_owned(), |damage| format!("no message can be read: {damage}"));
        return Err(Problem::new(path, found).expected(FORMAT.description).into());
    }
    let is_live = survey.topics.iter().any(|(name, topic)| live::is_record(name, &topic.type_name));
    if is_live && options.topics == TopicChoice::default() {
        return live::read(path, &recording, input_hash);
    }
    let roles = Roles::of_one_robot(&mut survey, &options.topics).map_err(|unfulfilled| unfulfilled.at(path))?;

    let mut maker = RecordMaker::new();
    let mut messages = recording.messages();
    let mut records = Vec::new();
    while messages.advance() {
        if let Some(message) = messages.message() {
            maker.take(&roles, &message, &mut records);
        }
    }
    let RecordMaker { truth, mut dropped, images: [depth, color], .. } = maker;
    let images = roles.camera.as_ref().map(|camera| ImageIndex {
        depth,
        color,
        recorded: Some(RecordedImages {
            path: path.to_path_buf(),
            depth_topic: camera.depth_topic.clone(),
            color_topic: camera.color_topic.clone(),
        }),
    });
    let undecodable: usize = survey.topics.values().map(|topic| topic.undecodable).sum();
    for _ in 0..undecodable {
        dropped.add(DropReason::Undecodable);
    }
    let mut notes = roles.notes.clone();
    notes.extend(damage);
    Ok(DataSet {
        format: Format { description: recording.description(), ..FORMAT },
        robot: robot(&roles),
        records,
        images,
        dropped,
        notes,
        input_hash,
        bag: Some(contents(&survey, roles, truth)),
        live: None,
        unpacked: None,
    })
}

impl Unfulfilled {
    /// As an error about what was recorded at a path.
    pub(super) fn at(self, path: &Path) -> ReadError {
        let Self { option, wanted, why, candidates } = self;
        let problem = Problem::new(path, format!("{option} {wanted}: {why}"));
        let closest = candidates.iter().max_by(|a, b| {
            strsim::jaro_winkler(&wanted, a).total_cmp(&strsim::jaro_winkler(&wanted, b)).then(b.cmp(a))
        });
        match closest {
            Some(closest) => {
                let all = candidates.join(", ");
                problem.expected(format!("one of: {all}")).advice(format!("Did you mean {closest}?")).into()
            }
            None => problem.advice(format!("Leave {option} out; `floorprint info` lists what is there")).into(),
        }
    }
}

/// The calibration that the recording itself states.
pub(super) fn robot(roles: &Roles) -> RobotConfig {
    let mut lidars = roles.lidars.iter().map(|lidar| LidarConfig {
        mount: lidar.mount,
        // Each ray has a time of its own.
        sweep_duration_s: 0.0,
        stamp_at: StampAt::Start,
    });
    RobotConfig {
        name: FORMAT.name.to_owned(),
        lidar: lidars.next().unwrap_or_default(),
        further_lidars: lidars.collect(),
        depth_camera: roles.camera.as_ref().and_then(|camera| camera.config.clone()),
        ..RobotConfig::default()
    }
}

fn contents(survey: &Survey, roles: Roles, truth: Vec<StampedPose>) -> BagContents {
    let summary = |(name, topic): (&String, &Topic)| TopicSummary {
        name: name.clone(),
        type_name: topic.type_name.clone(),
        encoding: topic.encoding.clone(),
        messages: topic.messages,
        undecodable: topic.undecodable,
        rate_hz: topic.rate_hz(),
        frames: topic.frames.keys().chain(&topic.children).filter(|frame| !frame.is_empty()).cloned().collect(),
    };
    BagContents {
        topics: survey.topics.iter().map(summary).collect(),
        roles: roles
            .reasons
            .into_iter()
            .map(|reason| RoleChoice { role: reason.role, what: reason.what, reason: reason.why })
            .collect(),
        truth: roles.truth.filter(|_| !truth.is_empty()).map(|topic| RecordedTruth { topic, poses: truth }),
    }
}
