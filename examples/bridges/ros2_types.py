"""Messages of ROS 2 as they are on the wire. Types are named as `rmw_cyclonedds` names them."""

from dataclasses import dataclass
from types import new_class

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int8, int32, uint8, uint16, uint32


def message(package, name, **fields):
    """Returns the type of a message. The order of the fields is that of the .msg file."""
    names = {"typename": f"{package}::msg::dds_::{name}_"}
    return dataclass(new_class(name, (IdlStruct,), names, lambda content: content.update(__annotations__=fields)))


String = message("std_msgs", "String", data=str)
Time = message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = message("std_msgs", "Header", stamp=Time, frame_id=str)
NavSatStatus = message("sensor_msgs", "NavSatStatus", status=int8, service=uint16)
NavSatFix = message(
    "sensor_msgs",
    "NavSatFix",
    header=Header,
    status=NavSatStatus,
    latitude=float64,
    longitude=float64,
    altitude=float64,
    position_covariance=array[float64, 9],
    position_covariance_type=uint8,
)
Vector = message("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Point = message("geometry_msgs", "Point", x=float64, y=float64, z=float64)
Quaternion = message("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose = message("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
PoseWithCovariance = message("geometry_msgs", "PoseWithCovariance", pose=Pose, covariance=array[float64, 36])
Twist = message("geometry_msgs", "Twist", linear=Vector, angular=Vector)
TwistWithCovariance = message("geometry_msgs", "TwistWithCovariance", twist=Twist, covariance=array[float64, 36])
Odometry = message(
    "nav_msgs",
    "Odometry",
    header=Header,
    child_frame_id=str,
    pose=PoseWithCovariance,
    twist=TwistWithCovariance,
)
