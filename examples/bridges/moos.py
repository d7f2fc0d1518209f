"""Runs pingmap in a MOOS community: moos.py HOST PORT vehicle.toml

`pymoos` is the client. The table of variables is in README.md.
"""

import json
import sys
import threading

from pingmap_process import Pingmap

NAVIGATION = {"NAV_X": "x", "NAV_Y": "y", "NAV_DEPTH": "depth", "NAV_HEADING": "heading"}
VARIABLES = [*NAVIGATION, "NODE_REPORT", "ACOMMS_NMEA_IN", "ACOMMS_NMEA_OUT", "PINGMAP_IN"]


class Bridge:
    """Turns the mail of a MOOS client into messages of pingmap, and publishes all answers."""

    def __init__(self, config, comms):
        self.comms, self.place, self.nav_s = comms, {}, None
        self.pingmap = Pingmap(config, on_message=self.publish)
        self.name = self.pingmap.hello["vehicle"]
        comms.set_on_connect_callback(lambda: all([comms.register(name, 0) for name in VARIABLES]))
        comms.set_on_mail_callback(self.read_mail)

    def publish(self, request, answer):
        """Publishes an answer, with the request that it answers."""
        if answer["type"] != "ok":
            self.comms.notify("PINGMAP_OUT", json.dumps({**answer, "request": request}), -1)

    def read_mail(self):
        for mail in self.comms.fetch():
            name, time_s = mail.name(), mail.time()
            if name in NAVIGATION:
                self.navigate(NAVIGATION[name], time_s, mail.double())
            elif name == "NODE_REPORT":
                self.locate_peer(time_s, mail.string())
            elif name == "PINGMAP_IN":
                self.pingmap.send_line(mail.string())
            else:
                self.pingmap.send({"type": "nmea", "time": time_s, "sentence": mail.string()})
        return True

    def navigate(self, key, time_s, value):
        """Collects the variables of one position. A position ends when the next x arrives, at most once a second."""
        is_due = self.nav_s is None or time_s - self.nav_s >= 1
        if key == "x" and {"x", "y"} <= self.place.keys() and is_due:
            self.pingmap.send({"type": "nav", "time": self.place_s, "position": self.place})
            self.nav_s = time_s
        if key == "x":
            self.place_s = time_s
        self.place = {**self.place, key: value}

    def locate_peer(self, time_s, report):
        """Reports the position of a peer, at the time at which its own message arrived."""
        fields = {name: value for name, _, value in (field.partition("=") for field in report.split(","))}
        if {"NAME", "X", "Y"} <= fields.keys() and fields["NAME"] != self.name:
            position = {"x": float(fields["X"]), "y": float(fields["Y"])}
            if "DEP" in fields:
                position["depth"] = float(fields["DEP"])
            peer = {"member": fields["NAME"], "time": time_s, "source": "message"}
            self.pingmap.send({"type": "peer", "position": position, **peer})


if __name__ == "__main__":
    import pymoos

    client = pymoos.comms()
    bridge = Bridge(sys.argv[3], client)
    client.run(sys.argv[1], int(sys.argv[2]), "pPingmap")
    threading.Event().wait()
