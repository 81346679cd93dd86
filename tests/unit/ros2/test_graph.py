"""Keys, tokens and attachments as rmw_zenoh's design document writes them."""

import pytest

from quadctl.services.bridges.ros2 import graph

TYPE = graph.type_key("geometry_msgs/msg/PoseStamped", "10f3")
NODE = graph.GraphNode(0, "aabb", 1, "uav", "quadctl")


def test_a_key_has_the_domain_the_name_the_type_and_the_hash():
    key = graph.endpoint_key(7, "/uav/pose", TYPE)
    assert key == "7/uav/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3"


def test_a_nodes_token_has_its_namespace():
    assert NODE.token == "@ros2_lv/0/aabb/1/1/NN/%/%uav/quadctl"


def test_an_endpoints_token_has_its_name_type_and_quality():
    token = NODE.endpoint_token(2, "MP", "/uav/pose", TYPE, graph.RELIABLE)
    assert token == (
        "@ros2_lv/0/aabb/1/2/MP/%/%uav/quadctl/%uav%pose/"
        "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3/::,10:,:,:,,"
    )


def test_an_attachment_is_33_bytes():
    made = graph.attachment(1, 2, bytes(range(16)))
    assert made == b"\1" + bytes(7) + b"\2" + bytes(7) + b"\x10" + bytes(range(16))


def test_a_reply_has_the_requests_number_and_sender():
    gid = graph.gid_of(NODE.token)
    assert graph.reply_attachment(graph.attachment(5, 2, gid), 9) == graph.attachment(5, 9, gid)


@pytest.mark.parametrize("junk", [b"", bytes(32), bytes(33), bytes(34)])
def test_a_request_without_an_attachment_of_ours_has_no_reply(junk):
    assert graph.reply_attachment(junk, 9) is None
