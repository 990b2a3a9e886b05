//! What is in the messages, for whoever decodes them: a `FileDescriptorSet` of Protocol Buffers.
//!
//! Sources: `foxglove-sdk/schemas/proto` for the types, `google/protobuf/descriptor.proto` for how they are described.

use super::protobuf_writer::ProtobufWriter;
use std::collections::BTreeSet;

/// A type with its fields, numbered from 1: `name:type`, with `*` behind it where it is repeated. Names of an enumeration
/// stand in braces, numbered from 0.
const TYPES: [(&str, &str); 25] = [
    ("Vector2", "x:double y:double"),
    ("Vector3", "x:double y:double z:double"),
    ("Point3", "x:double y:double z:double"),
    ("Quaternion", "x:double y:double z:double w:double"),
    ("Pose", "position:Vector3 orientation:Quaternion"),
    ("Color", "r:double g:double b:double a:double"),
    ("KeyValuePair", "key:string value:string"),
    (
        "PackedElementField",
        "name:string offset:fixed32 type:NumericType{UNKNOWN,UINT8,INT8,UINT16,INT16,UINT32,INT32,FLOAT32,FLOAT64}",
    ),
    (
        "Grid",
        "timestamp:Timestamp frame_id:string pose:Pose column_count:fixed32 cell_size:Vector2 row_stride:fixed32 \
         cell_stride:fixed32 fields:PackedElementField* data:bytes",
    ),
    (
        "PointCloud",
        "timestamp:Timestamp frame_id:string pose:Pose point_stride:fixed32 fields:PackedElementField* data:bytes",
    ),
    ("CompressedImage", "timestamp:Timestamp data:bytes format:string frame_id:string"),
    ("PosesInFrame", "timestamp:Timestamp frame_id:string poses:Pose*"),
    (
        "FrameTransform",
        "timestamp:Timestamp parent_frame_id:string child_frame_id:string translation:Vector3 rotation:Quaternion",
    ),
    ("FrameTransforms", "transforms:FrameTransform*"),
    (
        "ArrowPrimitive",
        "pose:Pose shaft_length:double shaft_diameter:double head_length:double head_diameter:double color:Color",
    ),
    ("CubePrimitive", "pose:Pose size:Vector3 color:Color"),
    ("SpherePrimitive", "pose:Pose size:Vector3 color:Color"),
    ("CylinderPrimitive", "pose:Pose size:Vector3 bottom_scale:double top_scale:double color:Color"),
    (
        "LinePrimitive",
        "type:Type{LINE_STRIP,LINE_LOOP,LINE_LIST} pose:Pose thickness:double scale_invariant:bool points:Point3* \
         color:Color colors:Color* indices:fixed32*",
    ),
    ("TriangleListPrimitive", "pose:Pose points:Point3* color:Color colors:Color* indices:fixed32*"),
    ("TextPrimitive", "pose:Pose billboard:bool font_size:double scale_invariant:bool color:Color text:string"),
    (
        "ModelPrimitive",
        "pose:Pose scale:Vector3 color:Color override_color:bool url:string media_type:string data:bytes",
    ),
    (
        "SceneEntity",
        "timestamp:Timestamp frame_id:string id:string lifetime:Duration frame_locked:bool metadata:KeyValuePair* \
         arrows:ArrowPrimitive* cubes:CubePrimitive* spheres:SpherePrimitive* cylinders:CylinderPrimitive* \
         lines:LinePrimitive* triangles:TriangleListPrimitive* texts:TextPrimitive* models:ModelPrimitive*",
    ),
    ("SceneEntityDeletion", "timestamp:Timestamp type:Type{MATCHING_ID,ALL} id:string"),
    ("SceneUpdate", "deletions:SceneEntityDeletion* entities:SceneEntity*"),
];

/// The types of Google's that are used, each in a file of its own.
const GOOGLES: [(&str, &str); 2] = [("Timestamp", "timestamp"), ("Duration", "duration")];
const GOOGLES_FIELDS: &str = "seconds:int64 nanos:int32";

/// The description of a type `foxglove.NAME` with all types in it.
pub(super) fn file_descriptor_set(type_name: &str) -> Vec<u8> {
    let name = type_name.trim_start_matches("foxglove.");
    let mut needed = BTreeSet::new();
    collect(name, &mut needed);
    ProtobufWriter::message(|set| {
        let files = GOOGLES.iter().filter(|(google, _)| needed.contains(google));
        let path = |file: &str| format!("google/protobuf/{file}.proto");
        for (google, file) in files.clone() {
            set.nested(1, |descriptor| {
                descriptor.text(1, &path(file));
                descriptor.text(2, "google.protobuf");
                describe(descriptor, google, GOOGLES_FIELDS);
                descriptor.text(12, "proto3");
            });
        }
        set.nested(1, |descriptor| {
            descriptor.text(1, &format!("foxglove/{name}.proto"));
            descriptor.text(2, "foxglove");
            files.for_each(|(_, file)| descriptor.text(3, &path(file)));
            for (name, fields) in TYPES.iter().filter(|(name, _)| needed.contains(name)) {
                describe(descriptor, name, fields);
            }
            descriptor.text(12, "proto3");
        });
    })
}

/// A field as it stands in the list.
struct Field<'a> {
    name: &'a str,
    type_name: &'a str,
    /// Names of the enumeration that it is one of.
    values: Option<&'a str>,
    is_repeated: bool,
}

fn fields(list: &str) -> impl Iterator<Item = Field<'_>> {
    list.split_whitespace().filter_map(|field| {
        let (name, rest) = field.split_once(':')?;
        let (rest, is_repeated) = rest.strip_suffix('*').map_or((rest, false), |rest| (rest, true));
        let (type_name, values) = match rest.split_once('{') {
            Some((type_name, values)) => (type_name, Some(values.trim_end_matches('}'))),
            None => (rest, None),
        };
        Some(Field { name, type_name, values, is_repeated })
    })
}

/// Adds a type and all types in it.
fn collect<'a>(name: &'a str, needed: &mut BTreeSet<&'a str>) {
    let found = TYPES.iter().find(|(known, _)| *known == name);
    if !(found.is_some() || GOOGLES.iter().any(|(google, _)| *google == name)) || !needed.insert(name) {
        return;
    }
    if let Some((_, list)) = found {
        fields(list).for_each(|field| collect(field.type_name, needed));
    }
}

/// Writes a `DescriptorProto` into the file's.
fn describe(file: &mut ProtobufWriter, name: &str, list: &str) {
    file.nested(4, |message| {
        message.text(1, name);
        for (number, field) in (1..).zip(fields(list)) {
            let (kind, full_name) = kind_of(name, &field);
            message.nested(2, |descriptor| {
                descriptor.text(1, field.name);
                descriptor.integer(3, number);
                descriptor.integer(4, if field.is_repeated { 3 } else { 1 });
                descriptor.integer(5, kind);
                if let Some(full_name) = full_name {
                    descriptor.text(6, &full_name);
                }
            });
        }
        for field in fields(list) {
            let Some(values) = field.values else { continue };
            message.nested(4, |enumeration| {
                enumeration.text(1, field.type_name);
                for (number, value) in (0..).zip(values.split(',')) {
                    enumeration.nested(2, |descriptor| {
                        descriptor.text(1, value);
                        descriptor.integer(2, number);
                    });
                }
            });
        }
    });
}

/// The number of a field's kind in `FieldDescriptorProto`, and the name of its type where it is no number.
fn kind_of(parent: &str, field: &Field<'_>) -> (i64, Option<String>) {
    match field.type_name {
        "double" => (1, None),
        "int64" => (3, None),
        "int32" => (5, None),
        "fixed32" => (7, None),
        "bool" => (8, None),
        "string" => (9, None),
        "bytes" => (12, None),
        name if field.values.is_some() => (14, Some(format!(".foxglove.{parent}.{name}"))),
        name if GOOGLES.iter().any(|(google, _)| *google == name) => (11, Some(format!(".google.protobuf.{name}"))),
        name => (11, Some(format!(".foxglove.{name}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_description_has_all_types_in_it_and_no_others() {
        let set = file_descriptor_set("foxglove.Grid");
        let holds = |text: &str| set.windows(text.len()).any(|window| window == text.as_bytes());
        for name in
            [".foxglove.Pose", ".foxglove.PackedElementField.NumericType", ".google.protobuf.Timestamp", "FLOAT64"]
        {
            assert!(holds(name), "{name}");
        }
        assert!(!holds("SceneEntity") && !holds("duration.proto"));
    }

    #[test]
    fn every_type_that_is_named_is_known() {
        for (name, list) in TYPES {
            for field in fields(list) {
                let (kind, full_name) = kind_of(name, &field);
                let is_known = TYPES.iter().chain(&GOOGLES).any(|(known, _)| *known == field.type_name);
                assert!(full_name.is_none() || kind == 14 || is_known, "{name}.{}", field.name);
            }
        }
    }
}
