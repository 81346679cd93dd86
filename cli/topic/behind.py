"""A field behind a topic, `/uav/pose/position/x`, as rostopic echo takes it. Pure."""

from schemas.topics import TOPICS


def split(name: str) -> tuple[str, str]:
    """The name without the fields behind a topic of ours, and their path as `position.x`."""
    bare = name.strip("/")
    for spelling in (bare, bare.partition("/")[2]):
        for topic in TOPICS:
            begin, _, fields = spelling.partition(f"{topic.name}/")
            if not begin and fields.partition("/")[0] in topic.type.__struct_fields__:
                return bare.removesuffix(f"/{fields}"), fields.replace("/", ".")
    return name, ""
