// A viewer that uses Foxglove's own client: subscribes to every channel, decodes what comes by the schemas that are
// advertised, and prints what it found as JSON.
//
// Arguments: address, subprotocol, seconds to wait at most; optionally x and y of a pose that it says the robot is at.
import protocol from "@foxglove/ws-protocol";
import rosmsg from "@foxglove/rosmsg";
import serialization from "@foxglove/rosmsg2-serialization";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";
import WebSocket from "ws";

const { FoxgloveClient } = protocol;
const { parse } = rosmsg;
const { MessageReader, MessageWriter } = serialization;
const [address, subprotocol, waitS, x, y] = process.argv.slice(2);
const found = { channels: {}, errors: [], statuses: [] };
const began = performance.now();
const decoders = new Map();
const client = new FoxgloveClient({ ws: new WebSocket(address, [subprotocol]) });

function decoder(channel) {
  if (channel.encoding === "cdr") {
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    return (bytes) => reader.readMessage(bytes);
  }
  const set = descriptor.FileDescriptorSet.decode(Buffer.from(channel.schema, "base64"));
  const type = protobuf.Root.fromDescriptor(set).lookupType(channel.schemaName);
  return (bytes) => type.toObject(type.decode(bytes), { longs: Number, defaults: true, arrays: true });
}

const pick = {
  "foxglove.Grid": (m) => ({
    frame: m.frame_id, columns: m.column_count, cell: m.cell_size.x, corner: [m.pose.position.x, m.pose.position.y],
    fields: m.fields.map((field) => field.name), bytes: m.data.length,
    rows: m.data.length / m.row_stride, occupied: m.data.filter((v, i) => i % 4 === 0 && v === 20).length,
  }),
  "foxglove.SceneUpdate": (m) => ({
    entities: m.entities.map((e) => [e.id, e.frame_id, e.lines[0].points.length, e.lines[0].type, e.arrows.length]),
    last: m.entities[0].lines[0].points.at(-1),
  }),
  "foxglove.FrameTransforms": (m) => ({
    tree: m.transforms.map((t) => `${t.parent_frame_id}>${t.child_frame_id}`),
    x: m.transforms.map((t) => t.translation.x), stamp: m.transforms[0].timestamp,
  }),
  "foxglove.PointCloud": (m) => ({
    frame: m.frame_id, fields: m.fields.map((field) => field.name), points: m.data.length / m.point_stride,
    first: [0, 4].map((at) => Buffer.from(m.data).readFloatLE(at)),
  }),
  "foxglove.PosesInFrame": (m) => ({ frame: m.frame_id, poses: m.poses.length }),
  "geometry_msgs/msg/PoseWithCovarianceStamped": (m) => ({
    frame: m.header.frame_id, x: m.pose.pose.position.x, y: m.pose.pose.position.y, variance: m.pose.covariance[0],
  }),
  "diagnostic_msgs/msg/DiagnosticArray": (m) => ({ name: m.status[0].name, message: m.status[0].message }),
};

function end() {
  console.log(JSON.stringify(found));
  process.exit(0);
}

client.on("error", (error) => found.errors.push(String(error)));
client.on("close", end);
client.on("status", (status) => found.statuses.push(status.message));
client.on("serverInfo", (info) => {
  found.info = { name: info.name, capabilities: info.capabilities };
  if (x === undefined) return;
  const pose = parse(
    "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n" +
      "===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" +
      "===\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n" +
      "===\nMSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance\n" +
      "===\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n" +
      "===\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n" +
      "===\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    { ros2: true },
  );
  const channel = client.advertise({
    topic: "/initialpose", encoding: "cdr", schemaName: "geometry_msgs/msg/PoseWithCovarianceStamped",
  });
  client.sendMessage(channel, new MessageWriter(pose).writeMessage({
    header: { stamp: { sec: 0, nsec: 0 }, frame_id: "map" },
    pose: {
      pose: { position: { x: Number(x), y: Number(y), z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } },
      covariance: new Float64Array(36),
    },
  }));
});
client.on("advertise", (channels) => {
  for (const channel of channels) {
    const { topic, schemaName: schema } = channel;
    const entry = (found.channels[topic] = { schema, count: 0 });
    decoders.set(client.subscribe(channel.id), { entry, decode: decoder(channel), pick: pick[schema] });
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { entry, decode, pick } = decoders.get(subscriptionId);
  try {
    const message = decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    entry.count += 1;
    entry.firstMs ??= performance.now() - began;
    entry.timestamp = Number(timestamp) / 1e9;
    entry.newest = pick(message);
  } catch (error) {
    found.errors.push(`${entry.schema}: ${error.stack}`);
  }
});
setTimeout(end, 1000 * Number(waitS));
