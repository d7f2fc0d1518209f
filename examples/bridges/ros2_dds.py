"""Runs pingmap next to ROS 2, on the wire, with `cyclonedds` and without rclpy: ros2_dds.py vehicle.toml

Topics and types are named as `rmw_cyclonedds` names them. The table of topics is in README.md.
"""

import json
import math
import sys
import threading

from cyclonedds.core import Listener, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from pingmap_process import Pingmap
from ros2_types import NavSatFix, Odometry, String

SURFACED_S = 3.0  # The vehicle is at the surface for so long after a satellite fix.
SENSOR = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
RELIABLE = Qos(Policy.Reliability.Reliable(10**9), Policy.History.KeepLast(100))


class Calls(Listener):
    def __init__(self, function):
        super().__init__()
        self.function = function

    def on_data_available(self, reader):
        for sample in reader.take(100):
            if sample.sample_info.valid_data:  # A writer that leaves sends samples without data.
                self.function(sample)


class Bridge:
    def __init__(self, config, domain=0):
        participant = DomainParticipant(domain)
        self.out = DataWriter(participant, Topic(participant, "rt/pingmap/out", String), RELIABLE)
        self.pingmap = Pingmap(config, on_message=self.publish)
        self.fix_s, self.sent_s = -math.inf, {}
        self.readers = [
            DataReader(participant, Topic(participant, name, kind), qos, Calls(function))
            for name, kind, qos, function in (
                ("rt/fix", NavSatFix, SENSOR, self.absorb_fix),
                ("rt/odom", Odometry, SENSOR, self.absorb_odometry),
                ("rt/pingmap/in", String, RELIABLE, lambda line: self.pingmap.send_line(line.data)),
            )
        ]

    def publish(self, request, answer):
        """Publishes an answer, with the request that it answers."""
        if answer["type"] != "ok":
            self.out.write(String(json.dumps({**answer, "request": request})))

    def navigate(self, source, stamp, position, variances):
        """Sends a position, at most once a second from each source."""
        time_s = stamp.sec + 1e-9 * stamp.nanosec
        if time_s - self.sent_s.get(source, -math.inf) >= 1:
            self.sent_s[source] = time_s
            sigma = {"sigma": math.sqrt(max(variances))} if max(variances) > 0 else {}
            surfaced = time_s - self.fix_s < SURFACED_S
            self.pingmap.send({"type": "nav", "time": time_s, "position": position, "surfaced": surfaced, **sigma})

    def absorb_fix(self, fix):
        if fix.status.status >= 0:  # -1: no fix
            self.fix_s = fix.header.stamp.sec + 1e-9 * fix.header.stamp.nanosec
            position, covariance = {"lat": fix.latitude, "lon": fix.longitude}, fix.position_covariance
            self.navigate("fix", fix.header.stamp, position, (covariance[0], covariance[4]))

    def absorb_odometry(self, odometry):
        point, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        place = {"x": point.x, "y": point.y, "depth": -point.z, "heading": (90 - math.degrees(yaw)) % 360}
        covariance = odometry.pose.covariance
        self.navigate("odom", odometry.header.stamp, place, (covariance[0], covariance[7]))


if __name__ == "__main__":
    bridge = Bridge(sys.argv[1])
    threading.Event().wait()
