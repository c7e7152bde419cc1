"""Keys, tokens and attachments, compared with an independent implementation; type hashes, with rosbags."""

import warnings

import pytest
from rosbags.typesys import Stores, get_typestore

from lidario.errors import InvalidValue
from lidario.network.keys import Attachment
from lidario.ros.names import DIAGNOSTICS, LASERSCAN, POINTCLOUD2, RELIABLE_10, MessageType, Node, gid_of

with warnings.catch_warnings():
    # It imports what is deprecated in the newest Python; that is not ours.
    warnings.simplefilter("ignore")
    from zenoh_ros2_sdk import attachment as theirs_attachment
    from zenoh_ros2_sdk import entity, keyexpr

ZID = "c4f1b2"
TYPES = {
    "sensor_msgs/msg/LaserScan": LASERSCAN,
    "sensor_msgs/msg/PointCloud2": POINTCLOUD2,
    "diagnostic_msgs/msg/DiagnosticArray": DIAGNOSTICS,
}
NODES = [Node(), Node("front_lidar", "/robot1", 7), Node("n", "/a/b", 232, "kilted")]


@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
@pytest.mark.parametrize(("name", "kind"), TYPES.items(), ids=lambda each: str(each).rpartition("/")[2])
def test_the_type_hashes_are_those_of_the_definitions(store: Stores, name: str, kind: MessageType) -> None:
    assert get_typestore(store).hash_rihs01(name) == kind.hash
    assert kind.dds == name.replace("/", "::").replace("::msg::", "::msg::dds_::") + "_"


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("topic", ["scan", "/scan", "front/scan"])
def test_keys_and_tokens_are_those_of_another_implementation(node: Node, topic: str) -> None:
    full = node.topic(topic)
    other = entity.NodeEntity(node.domain, ZID, 0, node.name, node.namespace)
    assert node.data_key(full, LASERSCAN) == keyexpr.topic_keyexpr(node.domain, full, LASERSCAN.dds, LASERSCAN.hash)
    assert node.node_token(ZID) == keyexpr.node_liveliness_keyexpr(other)
    end = entity.EndpointEntity(
        other, 1, entity.EntityKind.PUBLISHER, full, LASERSCAN.dds, LASERSCAN.hash, RELIABLE_10
    )
    assert node.publisher_token(ZID, 1, full, LASERSCAN) == keyexpr.endpoint_liveliness_keyexpr(end)


def test_humble_has_a_word_in_the_place_of_the_hash() -> None:
    node = Node(distro="humble")
    assert node.data_key("/scan", LASERSCAN) == "0/scan/sensor_msgs::msg::dds_::LaserScan_/TypeHashNotSupported"
    assert "/LaserScan_/TypeHashNotSupported/" in node.publisher_token(ZID, 1, "/scan", LASERSCAN).replace(
        "dds_::", "/"
    )


def test_the_attachment_is_read_by_another_implementation() -> None:
    gid = gid_of("token")
    ours = Attachment(5, 1_700_000_000_000_000_123, gid).to_bytes()
    read = theirs_attachment.Attachment.from_bytes(ours)
    assert (read.sequence_id, read.timestamp_ns, read.gid) == (5, 1_700_000_000_000_000_123, gid)
    assert read.to_bytes() == ours


@pytest.mark.parametrize(
    "arguments",
    [
        {"name": "my-node"}, {"name": ""}, {"name": "9"}, {"namespace": "robot 1"}, {"namespace": "/a//b"},
        {"domain": -1}, {"domain": 233}, {"distro": "foxy"},
    ],
)  # fmt: skip
def test_what_cannot_be_a_node(arguments: dict[str, object]) -> None:
    with pytest.raises(InvalidValue):
        Node(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("topic", ["", "/", "a b", "a//b", "a/", "1a", "a" * 300, "scan/**"])
def test_what_cannot_be_a_topic(topic: str) -> None:
    with pytest.raises(InvalidValue):
        Node().topic(topic)
