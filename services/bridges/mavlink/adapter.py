"""Autopilot that is not ours, in the place of our vehicle. Pure: time comes in.

It reads the autopilot's position as our poses, and sends safety's setpoints to it. The pilot decides
who flies: only while the autopilot is armed, and in the mode in which it follows programs, are there
poses; each such time is a boot of its own, so that safety drops what it wanted before. It never arms
the autopilot and never changes its mode.

Our world is ENU with bodies FLU; MAVLink has NED with bodies FRD.
"""

from collections.abc import Callable
from math import dist, inf
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Quaternion,
    Setpoint,
    Velocity,
    Zone,
)
from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.zones import FARTHEST, ZoneParams
from quadctl.services.bridges.base import Log
from quadctl.services.bridges.mavlink.plan import PlanItem, items_of
from quadctl.services.bridges.mavlink.telemetry import (
    NO_PLACE,
    NO_VELOCITY,
    OFFBOARD,
    attitude,
    turned,
)
from quadctl.services.bridges.mavlink.transfers import Peer, PlanKind, PlanUpload
from quadctl.services.runtime.goal_latch import GoalLatch

POSE_HZ = 50.0
_FEW = 0.6
"""Share of the wanted positions below which they are requested again."""
_UNIT = 1e-3
"""Rounding error of a quaternion's length."""
_HEARTBEAT, _ASK, _SETPOINT, _COUNT = 1.0, 1.0, 0.05, 2.0
"""Seconds between our heartbeats, our requests, our setpoints, and two counts of positions."""
_LOST, _BEAT_LOST, _OLD, _UPLOAD_AGAIN = 2.0, 3.0, 0.5, 5.0
"""Seconds without a message, a heartbeat and a position after which these are lost or too old, and
after which a fence that was not taken is uploaded again."""
_FLAT = 1_000.0
"""Distance (m) of two origins up to which the earth is flat enough."""
_RATES = (
    (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, POSE_HZ),
    (mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, POSE_HZ),
    # The pilot's mode should be known sooner than after a second.
    (mavlink.MAVLINK_MSG_ID_HEARTBEAT, 5.0),
)
"""Messages that are wanted, with their rates, Hz."""
_FARTHEST, _FASTEST = 10_000.0, 1_000.0
"""Largest coordinate (m) and speed (m/s) of a pose."""
_MOVED = 0.05
"""Distance (m) by which the autopilot may move its origin without a new boot."""
_STOPPED, _LONGEST_STOP = 0.1, 5.0
"""Speed (m/s) from which a vehicle that brakes holds its place, and seconds after which it does."""
_REBOOTED = 1000
"""Milliseconds by which the autopilot's clock goes back when it starts anew."""
_KINDS = {
    mavlink.MAV_AUTOPILOT_PX4: "PX4",
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot",
    mavlink.MAV_AUTOPILOT_GENERIC: "with the modes of a PX4",
}
_COPTERS = {
    mavlink.MAV_TYPE_GENERIC, mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_TYPE_COAXIAL,
    mavlink.MAV_TYPE_HELICOPTER, mavlink.MAV_TYPE_TRICOPTER, mavlink.MAV_TYPE_HEXAROTOR,
    mavlink.MAV_TYPE_OCTOROTOR, mavlink.MAV_TYPE_DECAROTOR, mavlink.MAV_TYPE_DODECAROTOR,
}  # fmt: skip
"""Vehicles that can stand still in the air; the numbers of modes are those of copters."""
_GUIDED = 4
"""Mode of ArduPilot's copters in which they fly to the setpoints of a program."""
_NEITHER = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
_PLACE, _VELOCITY = NO_VELOCITY | _NEITHER, NO_PLACE | _NEITHER
"""Masks of a setpoint that has a place alone, or a velocity alone."""

US: Peer = (245, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
"""Our system and component; ground stations are system 255."""
_NOBODY: Peer = (0, 0)
Send = Callable[[Any], None]


class Guarded(Struct, frozen=True):
    """Cage and zones that the autopilot gets as its own fence; `margin` (m) is that of the guards."""

    cage: CageSize
    zones: tuple[Zone, ...]
    margin: float

    def items(self, origin: Origin) -> list[PlanItem]:
        """Return the fence: the cage's sides, and the exclusion zones of all heights.

        A fence of MAVLink has no heights, and autopilots differ in what several inclusion zones mean.
        """
        x, y = self.cage.x + self.margin, self.cage.y + self.margin
        sides = ((-x, -y), (x, -y), (x, y), (-x, y))
        zones = [zone.params for zone in self.zones if zone.kind == "exclusion"]
        whole = [z for z in zones if z.floor <= -FARTHEST and z.ceiling >= FARTHEST]
        return items_of([ZoneParams("sides", "inclusion", polygon=sides), *whole], origin)


class AutopilotAdapter:
    """Autopilot of one vehicle. `name_boot` returns a new name at each call.

    Without `fenced` the autopilot gets no fence.
    """

    def __init__(
        self,
        origin: Origin,
        params: DynamicsParams,
        send: Send,
        log: Log,
        name_boot: Callable[[], str],
        *,
        fenced: bool,
    ) -> None:
        self._origin, self._params, self._send, self._log = origin, params, send, log
        self._name_boot, self._is_fenced = name_boot, fenced
        self._peer = _NOBODY
        self._due_heartbeat = self._due_request = self._due_setpoint = 0.0
        self._guarded: Guarded | None = None
        self._why_not = self._text = ""
        self._goal: Position | None = None
        self._speed = 0.0
        self._forget()
        self._end()

    def _forget(self) -> None:
        """Forget what the autopilot has told: it is silent, or has started anew."""
        self._heard = self._beaten = -inf
        self._kind, self._mode, self._is_armed = 0, -1, False
        self._clock, self._counted = -1, -inf
        self._positions = self._attitudes = 0
        self._offset: tuple[float, float, float] | None = None
        self._turned: tuple[Quaternion, BodyRates] | None = None
        self._place: Position | None = None
        self._placed = -inf
        self._upload: PlanUpload | None = None
        self._uploaded, self._has_fence = 0.0, False

    # What the autopilot sends

    def take(self, message: Any, now: float) -> Pose | None:
        """Take a message of the autopilot, at a time (monotonic s); return a pose to publish."""
        peer = message.get_srcSystem(), message.get_srcComponent()
        type_ = message.get_type()
        if type_ == "HEARTBEAT" and peer[1] == mavlink.MAV_COMP_ID_AUTOPILOT1:
            self._on_heartbeat(peer, message, now)
        elif peer == self._peer:
            self._heard = now
            if type_ == "LOCAL_POSITION_NED":
                return self._on_position(message, now)
            if take := self._takers.get(type_):
                take(self, message)
            elif self._upload:
                for answer in self._upload.take(message, now):
                    self._send(answer)
        return None

    def _on_heartbeat(self, peer: Peer, m: Any, now: float) -> None:
        if m.autopilot not in _KINDS or m.type not in _COPTERS:
            return
        if self._peer == _NOBODY:
            self._log.info("found system %d, %s", peer[0], _KINDS[m.autopilot])
            self._peer = peer
        if peer != self._peer:
            return
        self._heard = self._beaten = now
        self._kind = m.autopilot
        has_mode = m.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self._mode = m.custom_mode if has_mode else -1
        self._is_armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._judge(now)

    @property
    def _follows(self) -> bool:
        """Return whether the autopilot is in the mode in which it flies to our setpoints."""
        if self._kind == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            return self._mode == _GUIDED
        return self._mode == OFFBOARD

    def _judge(self, now: float) -> None:
        """Begin or end the time in which safety flies."""
        why = (
            "the autopilot is silent" if now - self._heard > _LOST
            else "the autopilot sends no heartbeat" if now - self._beaten > _BEAT_LOST
            else "the autopilot is not armed" if not self._is_armed
            else "the pilot flies: the mode is not OFFBOARD or GUIDED" if not self._follows
            else "the autopilot has not told where its origin is" if self._offset is None
            else "the autopilot's origin is over 1 km from ours: is --origin right?"
            if dist(self._offset, (0, 0, 0)) > _FLAT
            else "the autopilot sends no attitude" if self._turned is None
            else "the autopilot sends no position" if now - self._placed > _LOST
            # In flight, it keeps the fence before until it takes another one.
            else "the autopilot has not taken the fence"
            if self._is_fenced and not (self._has_fence or self._boot)
            else ""
        )  # fmt: skip
        if why != self._why_not:
            self._why_not = why
            if self._boot:
                self._log.warning("%s: no poses, the goal is dropped", why)
            elif why:
                self._log.info("%s: no poses", why)
        if why and self._boot:
            self._end()
            self._stopping = now
        elif not why and not self._boot:
            self._begin(now)

    def _begin(self, now: float) -> None:
        self._boot, self._seq = self._name_boot(), 0
        self._goal, self._stopping, self._last_setpoint = self._place, now, now
        self._log.warning("boot %s: safety flies", self._boot)

    def _end(self) -> None:
        self._boot, self._seq, self._since = "", 0, 0
        self._latch, self._ignores, self._alone = GoalLatch(), False, False
        self._goal, self._stopping, self._last_setpoint = None, -inf, 0.0

    def _on_position(self, m: Any, now: float) -> Pose | None:
        if m.time_boot_ms + _REBOOTED < self._clock:
            self._log.warning("the autopilot has started anew")
            self._forget()
            self._judge(now)
            return None
        place, velocity = (m.y, m.x, -m.z), (m.vy, m.vx, -m.vz)
        if (
            m.time_boot_ms <= self._clock
            or not all(abs(each) < _FARTHEST / 2 for each in place)
            or not all(abs(each) < _FASTEST for each in velocity)
        ):
            return None
        self._clock, self._positions = m.time_boot_ms, self._positions + 1
        if self._offset is None or self._turned is None:
            return None
        is_first = self._place is None
        self._place = Position(*(p + o for p, o in zip(place, self._offset, strict=True)))
        if is_first:
            self._log.info("the vehicle is at (%.1f, %.1f, %.1f) m", *astuple(self._place))
        self._placed, self._speed = now, dist(velocity, (0, 0, 0))
        self._judge(now)
        if not self._boot:
            return None
        if not self._seq:
            self._since = self._clock
        self._seq += 1
        stamp = (self._clock - self._since) / 1000
        return Pose(
            self._boot, self._seq - 1, stamp, self._place, Velocity(*velocity), *self._turned
        )

    def _on_attitude(self, m: Any) -> None:
        self._attitudes += 1
        rates = m.rollspeed, -m.pitchspeed, -m.yawspeed
        length = dist((m.q1, m.q2, m.q3, m.q4), (0, 0, 0, 0))
        if abs(length - 1) < _UNIT and all(abs(each) < _FASTEST for each in rates):
            q = Quaternion(*(each / length for each in (m.q1, m.q2, m.q3, m.q4)))
            # The rotation between the worlds and the bodies is its own inverse.
            self._turned = attitude(q), BodyRates(*rates)

    def _on_angles(self, m: Any) -> None:
        self._attitudes += 1
        rates = m.rollspeed, -m.pitchspeed, -m.yawspeed
        angles = m.roll, m.pitch, m.yaw
        if all(abs(each) < _FASTEST for each in (*rates, *angles)):
            self._turned = attitude(turned(*angles)), BodyRates(*rates)

    def _on_origin(self, m: Any) -> None:
        x, y = self._origin.to_world(m.latitude, m.longitude)
        offset = x, y, m.altitude / 1000 - self._origin.altitude
        if self._offset is not None and dist(offset, self._offset) > _MOVED:
            self._log.warning("the autopilot has moved its origin: the goal is dropped")
            # The place was that of the origin before.
            self._place, self._placed = None, -inf
            self._end()
        self._offset = offset

    def _on_text(self, m: Any) -> None:
        text = "".join(each if each.isprintable() else "?" for each in m.text.rstrip("\0"))
        if text != self._text:
            self._text = text
            self._log.info("autopilot: %s", text)

    _takers = {  # noqa: RUF012
        "ATTITUDE": _on_angles,
        "ATTITUDE_QUATERNION": _on_attitude,
        "GPS_GLOBAL_ORIGIN": _on_origin,
        "STATUSTEXT": _on_text,
    }

    # What safety wants

    def guard(self, guarded: Guarded) -> None:
        """Give the autopilot a fence for the present cage and zones."""
        if guarded != self._guarded:
            self._guarded, self._upload, self._has_fence = guarded, None, False

    def follow(self, setpoint: Setpoint, now: float) -> None:
        """Follow a setpoint of safety; one of another boot is ignored."""
        if not self._boot or setpoint.boot != self._boot:
            return
        silence, self._last_setpoint = now - self._last_setpoint, now
        if self._alone and silence <= self._params.grace + self._params.setpoint_timeout:
            self._latch.resumed()
            self._log.info("setpoints are back after %.2g s: flying on", silence)
        self._alone = False
        accepts = self._latch.accepts(setpoint.position, brake=setpoint.brake)
        if not (accepts or self._ignores):
            self._log.warning("setpoints are back: hovering until a new goal is requested")
        self._ignores = not accepts
        if setpoint.brake:
            self._brake(now)
        elif accepts:
            self._goal, self._stopping = setpoint.position, inf

    def _brake(self, now: float) -> None:
        if self._stopping == inf:
            self._goal, self._stopping = None, now

    # What is due

    def tick(self, now: float) -> None:
        """Send what is due: heartbeat, requests, the fence, and the setpoint at 20 Hz."""
        if now >= self._due_heartbeat:
            # Also before an autopilot is found: one that is sent to has to learn our address.
            self._due_heartbeat = now + _HEARTBEAT
            self._send(mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0,
                mavlink.MAV_STATE_ACTIVE, 3,
            ))  # fmt: skip
        if self._peer == _NOBODY:
            return
        self._judge(now)
        if now - self._heard > _LOST:
            # It may come back as another one, e.g. started anew, with another origin.
            self._forget()
            self._peer = _NOBODY
            return
        if (
            self._boot
            and now - self._last_setpoint > self._params.setpoint_timeout
            and not self._alone
        ):
            self._log.warning("no setpoint for %g s: braking", self._params.setpoint_timeout)
            self._brake(now)
            self._latch.stopped()
            self._alone = True
        if now >= self._due_request:
            self._due_request = now + _ASK
            self._request(now)
        self._send_fence(now)
        if now >= self._due_setpoint:
            self._due_setpoint = max(self._due_setpoint + _SETPOINT, now)
            self._send_setpoint(now)

    def _request(self, now: float) -> None:
        """Request the origin, which may move unseen, and messages that come too rarely."""
        self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        seconds = now - self._counted
        if seconds > _COUNT:
            if min(self._positions, self._attitudes) < _FEW * POSE_HZ * min(seconds, _COUNT):
                for message, hz in _RATES:
                    self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / hz)
            self._counted, self._positions, self._attitudes = now, 0, 0

    def _command(self, command: int, *params: float) -> None:
        filled = (*params, *(0.0,) * (7 - len(params)))
        self._send(mavlink.MAVLink_command_long_message(*self._peer, command, 0, *filled))

    def _send_fence(self, now: float) -> None:
        if self._guarded is None or not self._is_fenced:
            return
        upload = self._upload
        again = upload is not None and upload.result not in {"", "accepted"}
        if upload is None or (again and now - self._uploaded > _UPLOAD_AGAIN):
            items = self._guarded.items(self._origin)
            upload = self._upload = PlanUpload(PlanKind.FENCE, items, self._peer, US)
            self._uploaded = inf
        for message in upload.tick(now):
            self._send(message)
        if upload.result and self._uploaded == inf:
            self._uploaded = now
            if upload.result == "accepted":
                self._has_fence = True
                self._log.info("the autopilot has taken the fence")
            else:
                # It may be busy with another transfer, so it is asked again.
                why = f"refused with {upload.code}" if upload.code else "no answer"
                self._log.warning("the autopilot has not taken the fence: %s", why)

    def _send_setpoint(self, now: float) -> None:
        """Send where to fly; never a place that is not known to be near the vehicle, or safety's."""
        is_known = self._place is not None and now - self._placed < _OLD
        if not self._boot:
            is_guided = self._kind == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            if self._follows and self._is_armed:
                # An ArduPilot that we have not just flown may fly for a ground station.
                if not is_guided or now - self._stopping < _LONGEST_STOP:
                    self._put(None)
            elif is_known and not is_guided:
                # A PX4 wants setpoints before its mode is changed; it then begins where it is.
                self._put(self._place)
            return
        slow = self._speed < _STOPPED or now - self._stopping > _LONGEST_STOP
        if self._goal is None and is_known and slow:
            self._goal = self._place
        self._put(self._goal)

    def _put(self, place: Position | None) -> None:
        """Send a setpoint: a place, m, or without one velocity 0."""
        ignored, where = _VELOCITY, (0.0, 0.0, 0.0)
        if place is not None and self._offset is not None:
            east, north, up = (p - o for p, o in zip(astuple(place), self._offset, strict=True))
            ignored, where = _PLACE, (north, east, -up)
        self._send(mavlink.MAVLink_set_position_target_local_ned_message(
            max(self._clock, 0) & 0xFFFFFFFF, *self._peer, mavlink.MAV_FRAME_LOCAL_NED,
            ignored, *where, *(0.0,) * 8,
        ))  # fmt: skip
