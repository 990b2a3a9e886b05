"""Reads an MCAP file as Foxglove's own packages do and prints what is in it, as JSON."""
import importlib
import json
import sys

from google.protobuf.descriptor_pb2 import DescriptorProto
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2


def describe(type):
    """Its fields: name, number, type, whether it is repeated."""
    description = DescriptorProto()
    type.CopyToProto(description)
    return {(field.name, field.number, field.type, field.label) for field in description.field}


def differences(ours, name):
    """Fields of a type, and of all types in it, that differ from those of Foxglove's package."""
    theirs = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name).DESCRIPTOR
    found, seen, open_pairs = [], set(), [(ours, theirs)]
    while open_pairs:
        our, their = open_pairs.pop()
        if our.full_name in seen:
            continue
        seen.add(our.full_name)
        if our.full_name != their.full_name or describe(our) != describe(their):
            found.append(f"{our.full_name}: {describe(our) ^ describe(their)}")
            continue
        for field in our.fields:
            other = their.fields_by_name[field.name]
            if field.message_type:
                open_pairs.append((field.message_type, other.message_type))
            if field.enum_type:
                values = lambda kind: {(value.name, value.number) for value in kind.values}
                if values(field.enum_type) != values(other.enum_type):
                    found.append(f"{our.full_name}.{field.name}")
    return found


found = {"topics": {}, "differences": []}
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[Protobuf(), Ros2()])
    statistics = reader.get_summary().statistics
    found["announced"] = statistics.message_count
    found["chunks"] = statistics.chunk_count
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        topic = found["topics"].setdefault(channel.topic, {"schema": schema.name, "count": 0, "first": message.log_time})
        topic["count"] += 1
        topic["last"] = message.log_time
        if topic["count"] == 1 and schema.encoding == "protobuf":
            found["differences"] += differences(decoded.DESCRIPTOR, schema.name.removeprefix("foxglove."))
        if schema.name == "foxglove.Grid":
            rows = len(decoded.data) // decoded.row_stride
            opaque = sum(value == 255 for value in decoded.data[3::4])
            topic["newest"] = [decoded.column_count, rows, decoded.cell_size.x, opaque, decoded.pose.position.x]
        elif schema.name == "foxglove.SceneUpdate":
            topic["newest"] = {entity.id: len(entity.lines[0].points) for entity in decoded.entities}
        elif schema.name == "foxglove.PointCloud":
            topic["newest"] = len(decoded.data) // decoded.point_stride
        elif schema.name == "foxglove.CompressedImage":
            topic["newest"] = [decoded.format, bytes(decoded.data[1:4]).decode()]
        elif schema.name == "foxglove.FrameTransforms":
            topic["newest"] = [[t.parent_frame_id, t.child_frame_id] for t in decoded.transforms]
            topic["x"] = [t.translation.x for t in decoded.transforms]
        else:
            pose = decoded.pose
            topic["newest"] = [pose.pose.position.x, pose.pose.position.y, pose.covariance[0], pose.covariance[35]]
print(json.dumps(found))
