"""Makes the files in this folder with the packages that write such files on robots. Run `python make.py` in this folder.

Needs rosbags (Apache-2.0), mcap-ros2-support (MIT) and lcm (LGPL; needed only to make a file). The vehicle moves north at 2 m/s for one
minute. Each file holds a position every second, a received message every ten seconds, and a transmission five seconds after each reception.
"""

import pathlib
import shutil
import subprocess
import sys
import tempfile

import lcm
import numpy
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

START_NS = 1_777_809_600_000_000_000
SECOND_NS = 1_000_000_000
DEGREE_M = 111_066.0


def sentences():
    """Returns the sentences between host and modem, each with its time in nanoseconds."""
    said = [(0, "$CACFG,SRC,1")]
    for n in range(6):
        at = 10 * n * SECOND_NS
        said += [(at + 3 * SECOND_NS, "$CARXD,2,63,0,1,00FF"), (at + 8 * SECOND_NS, "$CATXD,1,63,0,2"),
                 (at + 8 * SECOND_NS, "$CATXP,2"), (at + 9 * SECOND_NS, "$CATXF,2")]  # fmt: skip
    return [(START_NS + at, sentence) for at, sentence in said]


def latitude(second):
    return 41.52 + 2.0 * second / DEGREE_M


HEADER = "std_msgs/Header header\n"
MCAP_TYPES = {
    "sensor_msgs/msg/NavSatFix": HEADER + """sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
""",
    "std_msgs/msg/String": "string data\n",
}


def write_mcap(path):
    with open(path, "wb") as file:
        writer = McapWriter(file)
        fix = writer.register_msgdef("sensor_msgs/msg/NavSatFix", MCAP_TYPES["sensor_msgs/msg/NavSatFix"])
        text = writer.register_msgdef("std_msgs/msg/String", MCAP_TYPES["std_msgs/msg/String"])
        for second in range(61):
            time_ns = START_NS + second * SECOND_NS
            message = {
                "header": {"stamp": {"sec": time_ns // SECOND_NS, "nanosec": 0}, "frame_id": "gps"},
                "status": {"status": 0, "service": 1},
                "latitude": latitude(second),
                "longitude": -70.67,
                "altitude": 0.0,
                "position_covariance": [0.0] * 9,
                "position_covariance_type": 0,
            }
            writer.write_message("/auv1/fix", fix, message, log_time=time_ns, publish_time=time_ns)
        for time_ns, sentence in sentences():
            writer.write_message("/auv1/modem", text, {"data": sentence}, log_time=time_ns, publish_time=time_ns)
        writer.finish()


def write_bag(folder):
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"]
    stamp = types["builtin_interfaces/msg/Time"]
    path = pathlib.Path(folder)
    shutil.rmtree(path, ignore_errors=True)
    with BagWriter(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        odometry = bag.add_connection("/auv1/odom", "nav_msgs/msg/Odometry", typestore=store)
        array = bag.add_connection("/auv1/modem", "std_msgs/msg/UInt8MultiArray", typestore=store)
        point, rest = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        vector, zeros = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0), numpy.zeros(36)
        for second in range(61):
            time_ns = START_NS + second * SECOND_NS
            message = types["nav_msgs/msg/Odometry"](
                header=header(stamp=stamp(sec=time_ns // SECOND_NS, nanosec=0), frame_id="odom"),
                child_frame_id="base_link",
                pose=types["geometry_msgs/msg/PoseWithCovariance"](
                    pose=types["geometry_msgs/msg/Pose"](
                        position=point(x=100.0, y=2.0 * second, z=-7.5), orientation=rest),
                    covariance=zeros,
                ),
                twist=types["geometry_msgs/msg/TwistWithCovariance"](
                    twist=types["geometry_msgs/msg/Twist"](linear=vector, angular=vector), covariance=zeros),
            )  # fmt: skip
            bag.write(odometry, time_ns, store.serialize_cdr(message, "nav_msgs/msg/Odometry"))
        for time_ns, sentence in sentences():
            label = types["std_msgs/msg/MultiArrayDimension"](label="bytes", size=len(sentence), stride=1)
            message = types["std_msgs/msg/UInt8MultiArray"](
                layout=types["std_msgs/msg/MultiArrayLayout"](dim=[label], data_offset=0),
                data=numpy.frombuffer(sentence.encode(), dtype=numpy.uint8),
            )
            bag.write(array, time_ns, store.serialize_cdr(message, "std_msgs/msg/UInt8MultiArray"))
    for file in path.glob("*.db3"):
        shutil.move(file, "ros2.db3")
    shutil.rmtree(path)


def write_lcm(path, types):
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["lcm-gen", "-p", "--ppath", folder, types], check=True)
        sys.path.insert(0, folder)
        import pm

        log = lcm.EventLog(path, mode="w", overwrite=True)
        for second in range(61):
            message = pm.nav_t()
            message.utime = START_NS // 1000 + second * 1_000_000
            message.place.lat, message.place.lon, message.depth = latitude(second), -70.67, 7.5
            message.n, message.raw, message.name, message.ok = 3, b"abc", "auv1", True
            log.write_event(message.utime, "AUV1_NAV", message.encode())
        for time_ns, sentence in sentences():
            message = pm.modem_t()
            message.utime, message.nmea = time_ns // 1000, sentence
            log.write_event(message.utime, "AUV1_MODEM", message.encode())
        log.close()


if __name__ == "__main__":
    write_mcap("ros2.mcap")
    write_bag("bag")
    write_lcm("auv1.lcmlog", "types.lcm")
