"""A robot that speaks ROS 2 by Cyclone DDS: publishes a drive, receives what Floorprint makes of it, and prints that.

Arguments: how many times as fast as it was, how many seconds to wait at the end, and what the services are asked
for: `map`, `follow` in a finished map, or `change` the session.
The drive comes as lines of JSON on standard input. Then services are asked for what they can, as nodes with
rmw_cyclonedds do: requests and answers begin with the client's number and that of the request.
"""
import itertools
import json
import random
import socket
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int8, int32, int64, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class PoseWithCovarianceStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"):
    header: Header
    pose: PoseWithCovariance


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class MapMetaData(IdlStruct, typename="nav_msgs::msg::dds_::MapMetaData_"):
    map_load_time: Time
    resolution: float32
    width: uint32
    height: uint32
    origin: Pose


@dataclass
class OccupancyGrid(IdlStruct, typename="nav_msgs::msg::dds_::OccupancyGrid_"):
    header: Header
    info: MapMetaData
    data: sequence[int8]


@dataclass
class OccupancyGridUpdate(IdlStruct, typename="map_msgs::msg::dds_::OccupancyGridUpdate_"):
    header: Header
    x: int32
    y: int32
    width: uint32
    height: uint32
    data: sequence[int8]


@dataclass
class Particle(IdlStruct, typename="nav2_msgs::msg::dds_::Particle_"):
    pose: Pose
    weight: float64


@dataclass
class ParticleCloud(IdlStruct, typename="nav2_msgs::msg::dds_::ParticleCloud_"):
    header: Header
    particles: sequence[Particle]


@dataclass
class Asked(IdlStruct, typename="asked"):
    """What Cyclone's layer of ROS puts before requests and answers."""
    client: int64
    number: int64


@dataclass
class Pose2D(IdlStruct, typename="geometry_msgs::msg::dds_::Pose2D_"):
    x: float64
    y: float64
    theta: float64


SENSOR = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5))
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
LATCHED = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
NOWHERE = Vector3(0.0, 0.0, 0.0)
STRAIGHT = Quaternion(0.0, 0.0, 0.0, 1.0)


def header(stamp, frame):
    sec = int(stamp // 1)
    return Header(Time(sec, min(round((stamp - sec) * 1e9), 999_999_999)), frame)


def seconds(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


numbers = itertools.count(1)
BYTE = {"byte": uint8}  # A result, a truth value, or nothing: a structure holds a byte.


def ask(robot, service, kind, request, answer=BYTE):
    """The answer of a service, its only field; None where none comes. A request is fields by name: type and value."""
    def typed(end, fields):
        package, name = kind.split("/")
        fields = {"asked": Asked, **fields}
        return make_idl_struct(f"{name}_{end}", f"{package}::srv::dds_::{name}_{end}_", fields)

    request_type = typed("Request", {name: type_ for name, (type_, _) in request.items()})
    reader = DataReader(robot, Topic(robot, f"rr/{service}Reply", typed("Response", answer)), qos=RELIABLE)
    writer = DataWriter(robot, Topic(robot, f"rq/{service}Request", request_type), qos=RELIABLE)
    began = time.monotonic()
    while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
        if time.monotonic() - began > 5:
            return None
        time.sleep(0.01)
    number = next(numbers)
    writer.write(request_type(Asked(4711, number), *(value for _, value in request.values())))
    while time.monotonic() - began < 20:
        for found in reader.take(10):
            # An answer is ours by its numbers.
            if (found.asked.client, found.asked.number) == (4711, number):
                return getattr(found, next(iter(answer)))
        time.sleep(0.005)
    return None


def load(robot, name, match_type, pose):
    fields = {"filename": (str, name), "match_type": (int8, match_type), "initial_pose": (Pose2D, pose)}
    return ask(robot, "floorprint/deserialize_map", "slam_toolbox/DeserializePoseGraph", fields)


def toolbox(robot, name, kind, *field):
    return ask(robot, "floorprint/" + name, "slam_toolbox/" + kind, {"field": field})


def dynamic_map(robot):
    grid = ask(robot, "floorprint/dynamic_map", "nav_msgs/GetMap", {"nothing": (uint8, 0)}, {"map": OccupancyGrid})
    return grid and [grid.info.width, grid.info.height, list(grid.data).count(100)]


def ask_while_mapping(robot):
    """Saves the session, and asks for what cannot be: nothing changes."""
    here = Pose2D(0.0, 0.0, 0.0)
    return {
        "map": dynamic_map(robot),
        "serialize": toolbox(robot, "serialize_map", "SerializePoseGraph", str, "site"),
        "clear": toolbox(robot, "clear_changes", "Clear", uint8, 0),
        "elsewhere": load(robot, "../site", 1, here),
        "nowhere": load(robot, "nowhere", 1, here),
        "localize": load(robot, "site", 3, here),
    }


def change_while_mapping(robot):
    """Begins anew, then goes on with what was saved before."""
    answers = {
        "reset": toolbox(robot, "reset", "Reset", uint8, 1),
        "load": load(robot, "site", 2, Pose2D(3.0, 0.0, 0.0)),
    }
    began = time.monotonic()
    while time.monotonic() - began < 10 and not (answers.get("map") or [0, 0, 0])[2]:
        answers["map"] = dynamic_map(robot)
        time.sleep(0.2)
    return answers


def babble():
    """Datagrams of chance, and ones that begin as those of DDS do, to all ports where nodes listen."""
    chance = random.Random(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        for number in range(3000):
            port = 7400 + chance.choice([0, 1, 10, 11, 12, 13, 14, 15])
            begin = b"RTPS\x02\x03\x01\x10" + chance.randbytes(12) if number % 2 else b""
            # Kinds of submessages with flags, and a length that may be wrong.
            kind = bytes([chance.choice([0x06, 0x07, 0x08, 0x09, 0x0C, 0x0E, 0x12, 0x13, 0x15, 0x16]), chance.randrange(16)])
            body = kind + chance.randbytes(chance.randrange(200)) if number % 2 else chance.randbytes(300)
            for address in ("127.0.0.1", "239.255.0.1"):
                line.sendto(begin + body, (address, port))


def ask_in_a_map(robot):
    """Says where the robot is, and loads the map once more."""
    pose = PoseWithCovariance(Pose(Vector3(3.0, 0.0, 0.0), STRAIGHT), [0.0] * 36)
    stamped = PoseWithCovarianceStamped(header(0.0, "map"), pose)
    here = Pose2D(3.0, 0.0, 0.0)
    return {
        "pose": ask(robot, "set_initial_pose", "nav2_msgs/SetInitialPose", {"pose": (PoseWithCovarianceStamped, stamped)}),
        "mapping": load(robot, "site", 1, here),
        "load": load(robot, "site", 3, here),
    }


def main():
    rate, wait_s, mode = float(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
    pose_topic = "amcl_pose" if mode == "follow" else "pose"
    drive = [json.loads(line) for line in sys.stdin]
    robot = DomainParticipant(0)
    topic = lambda name, kind: Topic(robot, "rt/" + name, kind)
    scans = DataWriter(robot, topic("scan", LaserScan), qos=SENSOR)
    odometry = DataWriter(robot, topic("odom", Odometry), qos=SENSOR)
    static = DataWriter(robot, topic("tf_static", TFMessage), qos=LATCHED)
    transforms = DataReader(robot, topic("tf", TFMessage), qos=RELIABLE)
    poses = DataReader(robot, topic(pose_topic, PoseWithCovarianceStamped), qos=RELIABLE)
    clouds = DataReader(robot, topic("particle_cloud", ParticleCloud), qos=SENSOR)
    maps = DataReader(robot, topic("map", OccupancyGrid), qos=LATCHED)
    meta_data = DataReader(robot, topic("map_metadata", MapMetaData), qos=LATCHED)
    updates = DataReader(robot, topic("map_updates", OccupancyGridUpdate), qos=RELIABLE)
    static.write(TFMessage([TransformStamped(header(0.0, "base_link"), "laser", Vector3(0.1, 0.0, 0.2), STRAIGHT)]))
    began = time.monotonic()
    while not scans.get_matched_subscriptions() and time.monotonic() - began < 20:
        time.sleep(0.05)
    time.sleep(0.5)

    found = {"poses": 0, "transforms": 0, "updates": 0, "maps": 0, "clouds": 0, "latency_ms": []}
    sent_at = {}

    def receive():
        now = time.monotonic()
        for message in transforms.take(1000):
            for transform in message.transforms:
                if transform.child_frame_id == "odom":
                    found["transforms"] += 1
                    found["largest_m"] = max(found.get("largest_m", 0.0), abs(transform.translation.x))
                    found["parent"] = transform.header.frame_id
        for message in poses.take(1000):
            found["poses"] += 1
            found.setdefault("first", [seconds(message), message.pose.pose.position.x])
            found["last"] = [seconds(message), message.pose.pose.position.x]
            stamp = round(seconds(message), 3)
            # What came first had to wait until it was clear who plays which role.
            if stamp in sent_at and now - sent_at[stamp] < 0.5:
                found["latency_ms"].append(1000 * (now - sent_at[stamp]))
        for message in clouds.take(100):
            found["clouds"] += 1
            particles = [[particle.pose.position.x, particle.weight] for particle in message.particles]
            found["particles"] = [seconds(message), particles]
        for message in maps.take(10):
            found["maps"] += 1
            cells = list(message.data)
            found["map"] = [message.info.width, message.info.height, cells.count(100), cells.count(0)]
        for message in meta_data.take(10):
            found["meta_data"] = [message.width, message.height, message.resolution]
        found["updates"] += len(updates.take(100))

    start, first = time.monotonic(), drive[0]["stamp"]
    rival = DataWriter(robot, topic("odom", Odometry), qos=SENSOR) if mode == "change" else None
    for record in drive:
        due = start + (record["stamp"] - first) / rate
        while time.monotonic() < due:
            receive()
            time.sleep(0.0005)
        if record["type"] == "odometry":
            pose = Pose(Vector3(record["x"], record["y"], 0.0), STRAIGHT)
            still = TwistWithCovariance(Twist(NOWHERE, NOWHERE), [0.0] * 36)
            odometry.write(
                Odometry(header(record["stamp"], "odom"), "base_link", PoseWithCovariance(pose, [0.0] * 36), still)
            )
            if rival and record["stamp"] > first + 1:
                # Another node says on the same topic that the robot is elsewhere.
                elsewhere = PoseWithCovariance(Pose(Vector3(50.0 - record["x"], 9.0, 0.0), STRAIGHT), [0.0] * 36)
                rival.write(Odometry(header(record["stamp"] + 0.001, "odom"), "base_link", elsewhere, still))
        else:
            ranges = record["ranges"]
            low, step = record["angle_min"], record["angle_increment"]
            high = low + step * (len(ranges) - 1)
            scans.write(
                # Between what the two nodes say, where there are two.
                LaserScan(header(record["stamp"] + (0.0006 if rival else 0.0), "laser"), low, high, step, 0.0, 0.0, 0.05, 20.0, ranges, [])
            )
            sent_at[round(record["stamp"], 3)] = time.monotonic()
        receive()
    end = time.monotonic() + wait_s
    while time.monotonic() < end:
        receive()
        time.sleep(0.0005)
    found["latency_ms"].sort()
    latency = found.pop("latency_ms")
    if latency:
        found["latency_ms"] = {"median": latency[len(latency) // 2], "p99": latency[int(0.99 * (len(latency) - 1))]}
    # Who joins late gets the map at once.
    late = DomainParticipant(0)
    reader = DataReader(late, Topic(late, "rt/map", OccupancyGrid), qos=LATCHED)
    asked = time.monotonic()
    while time.monotonic() - asked < 5:
        if reader.take(1):
            found["late_s"] = time.monotonic() - asked
            break
        time.sleep(0.005)
    if mode == "change":
        babble()
    found["services"] = {"map": ask_while_mapping, "follow": ask_in_a_map, "change": change_while_mapping}[mode](robot)
    print(json.dumps(found), flush=True)


main()
