"""Writes a small recording at rest as ROS itself would, with the PyPI package `rosbags` (0.11.9): bags and MCAP with each compression.

    python3 make.py

The content is that of `Folder` in tests/support/mod.rs: 201 inertial samples, 10 images of 64x48.
"""

import shutil
from pathlib import Path

import numpy
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

START_NS = 1_403_636_584_000_000_000
WIDTH, HEIGHT = 64, 48


def messages(store):
    """Topic, time and message, in the order of time."""
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    vector, quaternion = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    imu, image = store.types["sensor_msgs/msg/Imu"], store.types["sensor_msgs/msg/Image"]

    def stamped(nanos, frame, *sequence):
        return header(*sequence, stamp=time(sec=nanos // 10**9, nanosec=nanos % 10**9), frame_id=frame)

    sequence = [0] if "seq" in header.__dataclass_fields__ else []
    nothing = numpy.zeros(9)
    content = []
    for index in range(201):
        nanos = START_NS + 5_000_000 * index
        message = imu(
            header=stamped(nanos, "imu", *sequence),
            orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=nothing,
            angular_velocity=vector(x=float(f"0.00{index:03}"), y=-0.01, z=0.02),
            angular_velocity_covariance=nothing,
            linear_acceleration=vector(x=0.1, y=-0.2, z=float(f"9.8{index:03}")),
            linear_acceleration_covariance=nothing,
        )
        content.append((nanos, "/imu0", imu.__msgtype__, message))
    y, x = numpy.mgrid[:HEIGHT, :WIDTH]
    pixels = ((x // 8 + y // 8) % 2 * 200).astype(numpy.uint8)
    for index in range(10):
        nanos = START_NS + 25_000_000 + 100_000_000 * index
        message = image(
            header=stamped(nanos, "cam0", *sequence),
            height=HEIGHT,
            width=WIDTH,
            encoding="mono8",
            is_bigendian=0,
            step=WIDTH,
            data=pixels.reshape(-1),
        )
        content.append((nanos, "/cam0/image_raw", image.__msgtype__, message))
    return sorted(content, key=lambda entry: entry[0])


def bag(path, compression):
    path.unlink(missing_ok=True)
    store = get_typestore(Stores.ROS1_NOETIC)
    with_compression = Writer1(path)
    with_compression.set_compression(compression)
    with with_compression as writer:
        connections = {}
        for nanos, topic, kind, message in messages(store):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], nanos, store.serialize_ros1(message, kind))


def ros2(path):
    shutil.rmtree(path, ignore_errors=True)
    store = get_typestore(Stores.ROS2_JAZZY)
    with_compression = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with_compression.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with with_compression as writer:
        connections = {}
        for nanos, topic, kind, message in messages(store):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], nanos, store.serialize_cdr(message, kind))


if __name__ == "__main__":
    here = Path(__file__).parent
    bag(here / "still.bz2.bag", Writer1.CompressionFormat.BZ2)
    bag(here / "still.lz4.bag", Writer1.CompressionFormat.LZ4)
    ros2(here / "still_ros2")
