//! The images of a recording: found among its messages by their numbers, in a pass of their own.

use super::image::ImageMessage;
use super::messages::Kind;
use super::recording::Recording;
use super::{Channel, MessageSource as _};
use crate::error::{Problem, ReadError};
use crate::images::{ImageEntry, ImageIndex, ImagePlace, LoadedPair};
use crate::source::Source;
use floorprint::sensors::{ColorImage, DepthImage};
use floorprint::texture::ImagePair;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Messages are held until they take so many bytes; then their images are worked on side by side.
const BATCH_BYTES: usize = 32 << 20;

/// Where the images of a recording are.
#[derive(Debug, Clone)]
pub(crate) struct RecordedImages {
    pub(super) path: PathBuf,
    pub(super) depth_topic: String,
    pub(super) color_topic: String,
}

/// A message that holds an image.
struct Found {
    channel: Channel,
    bytes: Vec<u8>,
    stamp_s: f64,
}

/// A pair of which not all has been found yet, or that waits for its turn.
#[derive(Default)]
struct Waiting {
    depth: Option<Found>,
    color: Option<Found>,
}

impl RecordedImages {
    /// As [`ImageIndex::for_each_pair`]: from the first message to the last.
    pub(crate) fn for_each_pair<T: Send>(
        &self,
        index: &ImageIndex,
        pairs: &[ImagePair],
        stop: &(dyn Fn() -> bool + Sync),
        take: &(dyn Fn(LoadedPair) -> T + Sync),
    ) -> Vec<T> {
        let mut taken: BTreeMap<usize, T> = BTreeMap::new();
        let finished = self.read(index, pairs, stop, &mut |batch: Vec<(usize, Waiting)>| {
            let outcomes: Vec<T> = batch.par_iter().map(|(_, waiting)| take(waiting.load(&self.path))).collect();
            taken.extend(batch.iter().map(|(pair, _)| *pair).zip(outcomes));
        });
        if !stop() {
            // What was there when the recording was opened is not there any more.
            for pair in 0..pairs.len() {
                taken.entry(pair).or_insert_with(|| {
                    let gone = Problem::new(&self.path, "images that are not there any more");
                    take(Err(finished.as_ref().err().map_or_else(|| gone.into(), |error| again(error, &self.path))))
                });
            }
        }
        taken.into_values().collect()
    }

    /// Collects the messages of the pairs, batch by batch.
    fn read(
        &self,
        index: &ImageIndex,
        pairs: &[ImagePair],
        stop: &(dyn Fn() -> bool + Sync),
        work: &mut dyn FnMut(Vec<(usize, Waiting)>),
    ) -> Result<(), ReadError> {
        let wanted = |entries: &[ImageEntry], of: fn(&ImagePair) -> usize| -> BTreeMap<usize, (usize, f64)> {
            let number = |(pair, images): (usize, &ImagePair)| {
                let entry = entries.get(of(images))?;
                let ImagePlace::Message(number) = entry.place else { return None };
                Some((number, (pair, entry.stamp_s)))
            };
            pairs.iter().enumerate().filter_map(number).collect()
        };
        let (depths, colors) = (wanted(&index.depth, |pair| pair.depth), wanted(&index.color, |pair| pair.color));
        let mut waiting: BTreeMap<usize, Waiting> = BTreeMap::new();
        let mut batch = Vec::new();
        let (mut bytes, mut missing) = (0, pairs.len());
        let (mut depth_number, mut color_number) = (0, 0);
        let source = Source::open(&self.path)?;
        let recording = Recording::open(&source)?;
        let mut messages = recording.messages();
        while missing > 0 && !stop() && messages.advance() {
            let Some(message) = messages.message() else { continue };
            let is_depth = message.channel.topic == self.depth_topic;
            if !is_depth && message.channel.topic != self.color_topic {
                continue;
            }
            let (numbers, number) = if is_depth { (&depths, &mut depth_number) } else { (&colors, &mut color_number) };
            *number += 1;
            let Some(&(pair, stamp_s)) = numbers.get(&(*number - 1)) else { continue };
            let found = Found { channel: message.channel.clone(), bytes: message.bytes.to_vec(), stamp_s };
            let entry = waiting.entry(pair).or_default();
            *(if is_depth { &mut entry.depth } else { &mut entry.color }) = Some(found);
            if let Some(whole) = entry.is_whole().then(|| waiting.remove(&pair)).flatten() {
                bytes += whole.bytes();
                missing -= 1;
                batch.push((pair, whole));
            }
            if bytes > BATCH_BYTES {
                work(std::mem::take(&mut batch));
                bytes = 0;
            }
        }
        work(batch);
        Ok(())
    }
}

impl Waiting {
    fn is_whole(&self) -> bool {
        self.depth.is_some() && self.color.is_some()
    }

    fn bytes(&self) -> usize {
        [&self.depth, &self.color].into_iter().flatten().map(|found| found.bytes.len()).sum()
    }

    fn load(&self, path: &Path) -> Result<(DepthImage, ColorImage), ReadError> {
        let wrong = |found: String| ReadError::from(Problem::new(path, found));
        let (Some(depth), Some(color)) = (&self.depth, &self.color) else {
            return Err(wrong("half a pair of images".to_owned()));
        };
        let [depth_message, color_message] = [depth, color].map(|found| {
            let kind = Kind::of(&found.channel.type_name);
            let message = kind.and_then(|kind| ImageMessage::read(kind, &found.channel, &found.bytes));
            message.ok_or_else(|| wrong("messages that are no images".to_owned()))
        });
        let depth = depth_message?.depth(depth.stamp_s).map_err(wrong)?;
        Ok((depth, color_message?.color(color.stamp_s).map_err(wrong)?))
    }
}

/// The same error once more.
fn again(error: &ReadError, path: &Path) -> ReadError {
    Problem::new(path, error.problem().found.clone()).into()
}
