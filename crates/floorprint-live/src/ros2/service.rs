//! A service: requests come in and answers go out as bytes.
//!
//! Nodes know their answers in one of two ways. Those with Cyclone DDS put a header before the request, which comes back
//! before the answer. With the others the middleware itself says beside the answer to which request it belongs ("enhanced
//! mapping" of OMG DDS-RPC 1.0, 7.5.2). A client's vendor, by which its identifier begins, tells which way is its.

use super::raw_message::RawMessage;
use ros2_client::dds::rustdds::no_key::DataWriterCdr;
use ros2_client::dds::rustdds::rpc::SampleIdentity;
use ros2_client::dds::rustdds::{SequenceNumber, Timestamp, WriteOptionsBuilder};
use ros2_client::{MessageInfo, RmwRequestId, Subscription};

/// What identifiers of Cyclone DDS begin with: its vendor's number.
const CYCLONE: [u8; 2] = [1, 0x10];
/// What announces CDR, bytes.
const CDR_HEADER: usize = 4;
/// Bytes of the header that requests and answers of Cyclone DDS have behind that. They are a multiple of eight, so that numbers
/// behind it lie as they would without.
const CYCLONE_HEADER: usize = 16;

/// A service.
pub(super) struct Service {
    pub(super) requests: Subscription<RawMessage>,
    pub(super) answers: DataWriterCdr<RawMessage>,
}

/// Who asked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked(RmwRequestId);

impl Service {
    /// The next request; `None` where it is none.
    pub(super) async fn next(&self) -> Option<(Asked, Vec<u8>)> {
        let (RawMessage(request), info) = self.requests.async_take().await.ok()?;
        Some((Asked::by(&info), request))
    }

    /// Sends an answer in CDR; `None` where it cannot be.
    pub(super) fn send(&self, asked: &Asked, answer: Vec<u8>) -> Option<()> {
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now());
        // Beside an answer in fragments, as large ones are, RustDDS writes this so that Cyclone DDS cannot read it.
        let options =
            if asked.is_cyclone() { options } else { options.related_sample_identity(SampleIdentity::from(asked.0)) };
        self.answers.write_with_options(RawMessage(answer), options.build()).ok().map(drop)
    }
}

impl Asked {
    fn by(info: &MessageInfo) -> Self {
        let own = RmwRequestId { writer_gid: info.publisher_gid(), sequence_number: info.sequence_number() };
        let mut id = info.related_request_id().unwrap_or(own);
        // Fast DDS leaves it open.
        if id.sequence_number == i64::from(SequenceNumber::UNKNOWN) {
            id.sequence_number = own.sequence_number;
        }
        Self(id)
    }

    fn is_cyclone(&self) -> bool {
        self.0.writer_gid.as_bytes().starts_with(&CYCLONE)
    }

    /// What the answer begins with, and the request without that; `None` where it is too short.
    pub(super) fn take_apart(&self, mut request: Vec<u8>) -> Option<(Vec<u8>, Vec<u8>)> {
        let length = CDR_HEADER + if self.is_cyclone() { CYCLONE_HEADER } else { 0 };
        let prefix = request.get(..length)?.to_vec();
        request.drain(CDR_HEADER..length);
        Some((prefix, request))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_of_cyclone_dds_comes_back() {
        let request: Vec<u8> = (0..30).collect();
        let asked = |first: [u8; 2]| {
            let mut gid = [7; 16];
            gid[..2].copy_from_slice(&first);
            Asked(RmwRequestId { writer_gid: gid.into(), sequence_number: 1 })
        };
        let others = asked([1, 15]).take_apart(request.clone()).unwrap();
        assert_eq!(others, (request[..4].to_vec(), request.clone()));
        let (prefix, rest) = asked([1, 16]).take_apart(request.clone()).unwrap();
        assert_eq!((&prefix[..], &rest[..4], &rest[4..]), (&request[..20], &request[..4], &request[20..]));
        assert_eq!(asked([1, 16]).take_apart(request[..19].to_vec()), None);
    }
}
