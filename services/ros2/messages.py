"""Messages of ROS 2 that the bridge speaks, with their frozen type hashes (Jazzy and later).

Fields and their order are those of the packages of ROS; units are SI, frames as in REP 103. The
tests check fields and hashes against an independent package. `TYPES` and `SERVICES` are the tables.
"""

from typing import Any, Generic, NamedTuple, TypeVar

from msgspec import Struct

from quadctl.services.ros2.cdr import (
    Array36,
    Bool,
    Float32,
    Float64,
    Int32,
    Int64,
    Uint8,
    Uint32,
    Uint64,
)

M = TypeVar("M", bound=Struct)
R = TypeVar("R", bound=Struct)

_ZEROS: Array36 = (0.0,) * 36


class RosTime(Struct, frozen=True):
    """Time since the epoch of its clock: s, and ns within the second. Also a duration."""

    sec: Int32 = 0
    nanosec: Uint32 = 0


class Header(Struct, frozen=True):
    """Time and frame of a message."""

    stamp: RosTime = RosTime()
    frame_id: str = ""


class Vector(Struct, frozen=True):
    """Point (m) or vector."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


class Orientation(Struct, frozen=True):
    """Unit quaternion."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


class PlainPose(Struct, frozen=True):
    """Position (m) and orientation."""

    position: Vector = Vector()
    orientation: Orientation = Orientation()


class PoseStamped(Struct, frozen=True):
    """geometry_msgs/msg/PoseStamped."""

    header: Header
    pose: PlainPose


class Transform(Struct, frozen=True):
    """Translation (m) and rotation, from parent to child."""

    translation: Vector
    rotation: Orientation


class TransformStamped(Struct, frozen=True):
    """Transform from the header's frame to a child frame."""

    header: Header
    child_frame_id: str
    transform: Transform


class TFMessage(Struct, frozen=True):
    """tf2_msgs/msg/TFMessage."""

    transforms: tuple[TransformStamped, ...]


class PoseWithCovariance(Struct, frozen=True):
    """Pose, and the row-major 6 x 6 covariance of position and rotation."""

    pose: PlainPose
    covariance: Array36 = _ZEROS


class Twist(Struct, frozen=True):
    """Velocity (m/s) and angular velocity (rad/s)."""

    linear: Vector
    angular: Vector


class TwistWithCovariance(Struct, frozen=True):
    """Twist, and the row-major 6 x 6 covariance of its two parts."""

    twist: Twist
    covariance: Array36 = _ZEROS


class Odometry(Struct, frozen=True):
    """nav_msgs/msg/Odometry: pose in the header's frame, twist in the child frame."""

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


class FluidPressure(Struct, frozen=True):
    """sensor_msgs/msg/FluidPressure: Pa, absolute; variance 0 means unknown."""

    header: Header
    fluid_pressure: Float64
    variance: Float64 = 0.0


class String(Struct, frozen=True):
    """std_msgs/msg/String."""

    data: str


class Clock(Struct, frozen=True):
    """rosgraph_msgs/msg/Clock: simulated time."""

    clock: RosTime


class Colour(Struct, frozen=True):
    """Colour and opacity, each 0 to 1."""

    r: Float32 = 0.0
    g: Float32 = 0.0
    b: Float32 = 0.0
    a: Float32 = 0.0


class CompressedImage(Struct, frozen=True):
    """Texture of a marker."""

    header: Header = Header()
    format: str = ""
    data: bytes = b""


class UVCoordinate(Struct, frozen=True):
    """Point of a texture, 0 to 1."""

    u: Float32
    v: Float32


class MeshFile(Struct, frozen=True):
    """Mesh of a marker."""

    filename: str = ""
    data: bytes = b""


class Marker(Struct, frozen=True):
    """Shape in RViz, known by `ns` and `id`; LINE_LIST (5) joins its points pairwise."""

    header: Header
    ns: str
    id: Int32
    type: Int32
    action: Int32
    pose: PlainPose = PlainPose()
    scale: Vector = Vector()
    color: Colour = Colour()
    lifetime: RosTime = RosTime()
    frame_locked: Bool = False
    points: tuple[Vector, ...] = ()
    colors: tuple[Colour, ...] = ()
    texture_resource: str = ""
    texture: CompressedImage = CompressedImage()
    uv_coordinates: tuple[UVCoordinate, ...] = ()
    text: str = ""
    mesh_resource: str = ""
    mesh_file: MeshFile = MeshFile()
    mesh_use_embedded_materials: Bool = False


class MarkerArray(Struct, frozen=True):
    """visualization_msgs/msg/MarkerArray."""

    markers: tuple[Marker, ...]


class SetBoolRequest(Struct, frozen=True):
    """Request of std_srvs/srv/SetBool."""

    data: Bool


class TriggerResponse(Struct, frozen=True):
    """Response of std_srvs/srv/SetBool and Trigger: success, or the reason in `message`."""

    success: Bool
    message: str


class TriggerRequest(Struct, frozen=True):
    """Request of std_srvs/srv/Trigger: empty, for which CDR has one byte."""

    structure_needs_at_least_one_member: Uint8 = 0


class ParameterValue(Struct, frozen=True):
    """Value of a parameter: the field that `type` selects; see ParameterType in `parameters`."""

    type: Uint8 = 0
    bool_value: Bool = False
    integer_value: Int64 = 0
    double_value: Float64 = 0.0
    string_value: str = ""
    byte_array_value: bytes = b""
    bool_array_value: tuple[Bool, ...] = ()
    integer_array_value: tuple[Int64, ...] = ()
    double_array_value: tuple[Float64, ...] = ()
    string_array_value: tuple[str, ...] = ()


class RosParameter(Struct, frozen=True):
    """Name and value."""

    name: str
    value: ParameterValue


class FloatingPointRange(Struct, frozen=True):
    """Closed interval of a parameter; step 0 for none."""

    from_value: Float64
    to_value: Float64
    step: Float64 = 0.0


class IntegerRange(Struct, frozen=True):
    """Closed interval of a parameter."""

    from_value: Int64
    to_value: Int64
    step: Uint64 = 0


class ParameterDescriptor(Struct, frozen=True):
    """Type, description and bounds of a parameter; at most one range."""

    name: str
    type: Uint8 = 0
    description: str = ""
    additional_constraints: str = ""
    read_only: Bool = False
    dynamic_typing: Bool = False
    floating_point_range: tuple[FloatingPointRange, ...] = ()
    integer_range: tuple[IntegerRange, ...] = ()


class SetParametersResult(Struct, frozen=True):
    """Success, or the reason of a refusal."""

    successful: Bool
    reason: str = ""


class Names(Struct, frozen=True):
    """Request of GetParameters, GetParameterTypes and DescribeParameters."""

    names: tuple[str, ...]


class Values(Struct, frozen=True):
    """Response of GetParameters."""

    values: tuple[ParameterValue, ...]


class ParameterTypes(Struct, frozen=True):
    """Response of GetParameterTypes."""

    types: bytes


class Descriptors(Struct, frozen=True):
    """Response of DescribeParameters."""

    descriptors: tuple[ParameterDescriptor, ...]


class Parameters(Struct, frozen=True):
    """Request of SetParameters and SetParametersAtomically."""

    parameters: tuple[RosParameter, ...]


class Results(Struct, frozen=True):
    """Response of SetParameters: one result for each parameter."""

    results: tuple[SetParametersResult, ...]


class Result(Struct, frozen=True):
    """Response of SetParametersAtomically."""

    result: SetParametersResult


class ListRequest(Struct, frozen=True):
    """Request of ListParameters: names below these prefixes, to this depth (0: any)."""

    prefixes: tuple[str, ...] = ()
    depth: Uint64 = 0


class ListResult(Struct, frozen=True):
    """Names, and the prefixes that they have."""

    names: tuple[str, ...]
    prefixes: tuple[str, ...] = ()


class ListResponse(Struct, frozen=True):
    """Response of ListParameters."""

    result: ListResult


class RosType(NamedTuple, Generic[M]):
    """Type of a topic: its name in ROS, its hash (RIHS01), and its struct."""

    name: str
    hash: str
    message: type[M]


class RosService(NamedTuple, Generic[M, R]):
    """Type of a service: its name in ROS, its hash (RIHS01), its request and response."""

    name: str
    hash: str
    request: type[M]
    response: type[R]


TYPES: tuple[RosType[Any], ...] = (
    RosType(
        "geometry_msgs/msg/PoseStamped",
        "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
        PoseStamped,
    ),
    RosType(
        "nav_msgs/msg/Odometry",
        "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
        Odometry,
    ),
    RosType(
        "tf2_msgs/msg/TFMessage",
        "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
        TFMessage,
    ),
    RosType(
        "sensor_msgs/msg/FluidPressure",
        "22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
        FluidPressure,
    ),
    RosType(
        "visualization_msgs/msg/MarkerArray",
        "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
        MarkerArray,
    ),
    RosType(
        "std_msgs/msg/String",
        "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        String,
    ),
    RosType(
        "rosgraph_msgs/msg/Clock",
        "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
        Clock,
    ),
)

SET_BOOL = RosService(
    "std_srvs/srv/SetBool",
    "abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    SetBoolRequest,
    TriggerResponse,
)
TRIGGER = RosService(
    "std_srvs/srv/Trigger",
    "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    TriggerRequest,
    TriggerResponse,
)
GET_PARAMETERS = RosService(
    "rcl_interfaces/srv/GetParameters",
    "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    Names,
    Values,
)
GET_PARAMETER_TYPES = RosService(
    "rcl_interfaces/srv/GetParameterTypes",
    "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    Names,
    ParameterTypes,
)
DESCRIBE_PARAMETERS = RosService(
    "rcl_interfaces/srv/DescribeParameters",
    "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    Names,
    Descriptors,
)
SET_PARAMETERS = RosService(
    "rcl_interfaces/srv/SetParameters",
    "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    Parameters,
    Results,
)
SET_PARAMETERS_ATOMICALLY = RosService(
    "rcl_interfaces/srv/SetParametersAtomically",
    "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    Parameters,
    Result,
)
LIST_PARAMETERS = RosService(
    "rcl_interfaces/srv/ListParameters",
    "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    ListRequest,
    ListResponse,
)
SERVICES: tuple[RosService[Any, Any], ...] = (
    SET_BOOL,
    TRIGGER,
    GET_PARAMETERS,
    GET_PARAMETER_TYPES,
    DESCRIBE_PARAMETERS,
    SET_PARAMETERS,
    SET_PARAMETERS_ATOMICALLY,
    LIST_PARAMETERS,
)


def type_of(message: type[M]) -> RosType[M]:
    """Return the type of a topic by its struct."""
    return next(each for each in TYPES if each.message is message)
