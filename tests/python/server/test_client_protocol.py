"""Messages of the client as bytes, and its addresses."""

import inspect
import json
import re
import struct

import numpy as np
import pytest
from conftest import ROOT
from messages import refused
from websockets.frames import Opcode
from websockets.protocol import Protocol, Side
from websockets.utils import accept_key

import flockstep
from flockstep.client import AsyncClient, AsyncDrone, Client, Drone, changes, schema
from flockstep.client import protocol as pb
from flockstep.client.address import parse_address
from flockstep.client.call import STREAMED, Subscription, call, nothing
from flockstep.client.configs import change_json
from flockstep.client.frames import decode, encode
from flockstep.client.session import Session

ARRAYS = {
    "flags": np.array([True, False, True]),
    "pixels": np.arange(12, dtype=np.uint8).reshape(2, 2, 3),
    "classes": np.array([65535, 1], np.uint16),
    "indices": np.array([[-1], [2**31 - 1]], np.int32),
    "actions": np.array([-(2**63), 5], np.int64),
    "seeds": np.array([2**64 - 1], np.uint64),
    "ranges": np.array([[np.inf, -0.0, 1.5]], np.float32),
    "times": np.float64(1 / 3),
    "none": np.empty((0, 3), np.float32),
}


def reply_bytes(reply, values=b""):
    header = reply.SerializeToString()
    return struct.pack("<I", len(header)) + header + values


def test_a_request_is_size_header_and_values():
    request = pb.Request(id=3, step_envs=pb.StepEnvs())
    actions = np.array([[1, 2], [3, 4]], np.int64)
    data = encode(request, {"actions": actions})
    (size,) = struct.unpack("<I", data[:4])
    read = pb.Request.FromString(data[4 : 4 + size])
    assert (read.id, read.WhichOneof("operation")) == (3, "step_envs")
    assert [(a.name, a.dtype, list(a.shape)) for a in read.arrays] == [("actions", pb.DType.DTYPE_INT64, [2, 2])]
    assert data[4 + size :] == struct.pack("<4q", 1, 2, 3, 4)


def test_arrays_of_every_type_survive():
    data = encode(pb.Request(ping=pb.Ping()), ARRAYS)
    (size,) = struct.unpack("<I", data[:4])
    reply = pb.Reply(id=1, arrays=list(pb.Request.FromString(data[4 : 4 + size]).arrays), done=pb.Done())
    assert {array.dtype for array in reply.arrays} == {*pb.DType} - {pb.DType.DTYPE_UNSPECIFIED}
    read, arrays = decode(bytearray(reply_bytes(reply, data[4 + size :])))
    assert read.id == 1
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (arrays[name].dtype, arrays[name].shape) == (array.dtype, array.shape)
        assert arrays[name].tobytes() == array.tobytes()
        assert arrays[name].flags.aligned
        assert arrays[name].flags.writeable


def test_descriptions_of_arrays_that_were_read_before():
    random = np.random.default_rng(0)
    for i in range(2000):
        names = [str(random.choice(["a", "b", "x" * 200])) + str(j) for j in range(random.integers(4))]
        arrays = {name: np.zeros(random.choice([0, 1, 200], 2), np.uint8) for name in names}
        reply = pb.Reply(id=int(random.choice([0, 1, 127, 128, 2**63])), time=pb.Time(step=int(random.integers(300))))
        for name, array in arrays.items():
            reply.arrays.add(name=name, dtype=pb.DType.DTYPE_UINT8, shape=array.shape)
        read, found = decode(reply_bytes(reply, b"".join(array.tobytes() for array in arrays.values())))
        assert (read, list(found)) == (reply, list(arrays)), i
        assert [array.shape for array in found.values()] == [array.shape for array in arrays.values()], i


def test_a_described_request_is_not_described_again():
    request = pb.Request(step_envs=pb.StepEnvs())
    first = encode(request, {"actions": np.zeros(3)})
    assert encode(request, {"actions": np.ones(3)}) == first[:-24] + np.ones(3).tobytes()


def test_arrays_in_another_order_in_memory():
    columns = np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3))
    assert encode(pb.Request(fly=pb.Fly()), {"a": columns}).endswith(np.arange(6, dtype=np.float32).tobytes())
    assert encode(pb.Request(fly=pb.Fly()), {"a": columns[::2]}).endswith(np.arange(3, dtype=np.float32).tobytes())


def test_an_aligned_array_is_a_view_of_the_message():
    array = pb.Array(name="a", dtype=pb.DType.DTYPE_FLOAT64, shape=[1000])
    for pad in range(8):
        reply = pb.Reply(arrays=[array], error=pb.Error(text="x" * pad))
        buffer = bytearray(reply_bytes(reply, bytes(8000)))
        values = decode(buffer)[1]["a"]
        is_view = np.shares_memory(values, np.frombuffer(buffer, np.uint8))
        assert is_view == (len(buffer) % 8 == 0)


def reply_of(shape, values=b"", dtype=pb.DType.DTYPE_UINT8):
    return reply_bytes(pb.Reply(arrays=[pb.Array(name="a", dtype=dtype, shape=shape)]), values)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "malformed"),
        (struct.pack("<I", 100) + b"abc", "malformed"),
        (struct.pack("<I", 3) + b"\xff\xff\xff", "malformed"),
        (reply_bytes(pb.Reply(done=pb.Done()), b"x"), "bytes expected"),
        (reply_of([1 << 63, 0]), "shape"),
        (reply_of([1 << 31, 1 << 31, 0]), "shape"),
        (reply_of([1] * 9, b"x"), "shape"),
        (reply_of([2**40, 2**40]), "shape"),
        (reply_of([2], b"x" * 15, pb.DType.DTYPE_INT64), "cut off"),
        (reply_of([2], b"xx", 0), "unknown type 0"),
    ],
)
def test_malformed_messages_are_refused(data, said):
    with refused(ConnectionError, "the server sent", said):
        decode(data)


def handshake(session):
    key = session.to_send().split(b"Sec-WebSocket-Key: ")[1].split(b"\r\n")[0].decode()
    answer = f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept_key(key)}\r\n\r\n"
    return b"HTTP/1.1 101 Switching\r\n" + answer.encode()


def fed(session, stream, sizes):
    """Give a session a stream in pieces; return the messages, and what the session sent."""
    messages, sent, begin = [], b"", 0
    while begin < len(stream):
        space = session.space()
        size = min(next(sizes), len(space), len(stream) - begin)
        space[:size] = stream[begin : begin + size]
        messages += session.received(size)
        sent += session.to_send()
        begin += size
    return list(map(bytes, messages)), sent  # only now: messages keep their memory


@pytest.mark.parametrize("size", [1, 2, 3, 7, 1000, 70_000, None])
def test_messages_in_fragments_and_pieces(size):
    session = Session("ws://a/")
    large = np.random.default_rng(0).integers(0, 256, 200_000, np.uint8).tobytes()
    head = struct.pack(">BBQ", 0x82, 127, len(large))
    parts = [
        handshake(session),
        b"\x02\x02ab" + b"\x89\x01!" + b"\x00\x01c" + b"\x80\x01d",  # with a ping between
        b"\x82\x02ef" + b"\x82\x00" + b"\x81\x02gh",
        struct.pack(">BBH", 0x82, 126, 300) + large[:300],
        head + large,
        struct.pack(">BBQ", 0x02, 127, len(large)) + large + b"\x80\x01!",
        head + large,
        b"\x82\x02ij",
    ]
    rng = np.random.default_rng(1)
    sizes = iter(lambda: int(rng.integers(1, 100_000)) if size is None else size, 0)
    messages, sent = fed(session, b"".join(parts), sizes)
    assert session.is_open
    assert messages == [b"abcd", b"ef", b"", b"gh", large[:300], large, large + b"!", large, b"ij"]
    assert sent[0] == 0x8A  # the pong
    assert len(sent) == 7
    assert fed(session, b"\x88\x05\x03\xe9bye", sizes)[0] == []
    assert session.reason == "closed the connection: bye"
    assert session.received(0) == []


def framed(message):
    size = len(message)
    if size < 126:
        return bytes((0x82, size)) + message
    return (struct.pack(">BBH", 0x82, 126, size) if size < 1 << 16 else struct.pack(">BBQ", 0x82, 127, size)) + message


@pytest.mark.parametrize("seed", range(20))
def test_messages_of_changing_sizes_in_pieces(seed):
    random = np.random.default_rng(seed)
    session = Session("ws://a/")
    usual = int(random.choice([100, 4000, 9000, 70_000, 200_000, 1_100_000]))
    expected = []
    for _ in range(30):
        size = int(usual * random.uniform(0.9, 1.1)) if random.random() < 0.8 else int(random.integers(100_000))
        expected.append(random.integers(0, 256, size, np.uint8).tobytes())
    stream = handshake(session) + b"".join(map(framed, expected))
    most = int(random.choice([500, 10_000, 1_000_000]))
    messages, _ = fed(session, stream, iter(lambda: int(random.integers(1, most)), 0))
    assert messages == expected


def test_a_message_like_the_last_comes_into_the_memory_in_which_it_stays():
    session = Session("ws://a/")
    fed(session, handshake(session), iter(lambda: 1000, 0))
    values = np.arange(30_000, dtype=np.float64)
    reply = pb.Reply(id=5, arrays=[pb.Array(name="a", dtype=pb.DType.DTYPE_FLOAT64, shape=[30_000])])
    stream = framed(reply_bytes(reply, values.tobytes()))
    fed(session, stream, iter(lambda: 100_000, 0))
    for _ in range(3):
        space = session.space()
        space[: len(stream)] = stream
        (message,) = session.received(len(stream))
        read = decode(message)[1]["a"]
        np.testing.assert_array_equal(read, values)
        assert np.shares_memory(read, np.frombuffer(space, np.uint8))
        assert not np.shares_memory(read, np.frombuffer(session.space(), np.uint8))


def test_frames_of_requests():
    session = Session("ws://a/")
    fed(session, handshake(session), iter(lambda: 1000, 0))
    server = Protocol(Side.SERVER)
    for size in (0, 1, 125, 126, 65535, 65536, 100_000):
        message = np.random.default_rng(size).integers(0, 256, size, np.uint8).tobytes()
        server.receive_data(session.frame(message))
        (frame,) = server.events_received()
        assert (frame.opcode, frame.data, frame.fin) == (Opcode.BINARY, message, True)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (b"\x82\x82abcdef", "incorrect masking"),
        (b"\x82\x7f" + (1 << 40).to_bytes(8, "big"), "exceeds limit"),
        (b"\xc2\x01a", "reserved bits"),
        (b"\x85\x01a", "invalid opcode"),
        (b"\x80\x01a", "unexpected continuation frame"),
        (b"\x88\x01a", "close frame too short"),
    ],
)
def test_malformed_frames_end_the_session(frame, reason):
    session = Session("ws://a/")
    assert fed(session, handshake(session) + frame, iter(lambda: 1000, 0))[0] == []
    assert reason in session.reason
    assert session.reason.startswith("sent a malformed message: ")
    assert not session.is_open


def test_a_socket_that_ends():
    for stream in (b"", b"HTTP/1.1 101 Swi", b"SSH-2.0\r\n"):
        session = Session("ws://a/")
        fed(session, stream, iter(lambda: 5, 0))
        session.received(0)
        assert "is not a flockstep server" in session.reason or "is gone" in session.reason
    session = Session("ws://a/")
    fed(session, b"x" * 70_000, iter(lambda: 5000, 0))
    assert "is not a flockstep server" in session.reason
    session = Session("ws://a/")
    fed(session, handshake(session) + b"\x82\x05ab", iter(lambda: 50, 0))
    assert session.received(0) == []
    assert session.reason == "is gone: it closed the connection without a reason"


@pytest.mark.parametrize(
    ("address", "uri", "host", "port"),
    [
        ("localhost", "ws://localhost:41451/", "localhost", 41451),
        ("10.0.0.1:5", "ws://10.0.0.1:5/", "10.0.0.1", 5),
        ("[::1]:5", "ws://[::1]:5/", "::1", 5),
        ("ws://a.b:5/drones", "ws://a.b:5/drones", "a.b", 5),
        ("wss://a.b", "wss://a.b:41451/", "a.b", 41451),
    ],
)
def test_addresses(address, uri, host, port):
    parsed = parse_address(address, None, True)
    assert (parsed.uri, parsed.host, parsed.port, parsed.path) == (uri, host, port, "")
    assert (parsed.tls is not None) == address.startswith("wss")


@pytest.mark.parametrize(
    "address", ["", "a b:c", "http://a", "unix:", "ws://", "a:70000", "ws://u@h:1", "ws://h:1/?a", ":5"]
)
def test_bad_addresses_are_refused(address):
    with refused(ValueError, "address"):
        flockstep.connect(address)


def test_bad_options_are_refused(tmp_path):
    with refused(ValueError, "ca_file"):
        flockstep.connect("localhost", ca_file=tmp_path)
    with refused(ValueError, "check_hostname"):
        flockstep.connect("unix:/a", check_hostname=False)
    with refused(ValueError, "timeout_s", 0):
        flockstep.connect("localhost", timeout_s=0)
    with refused(TypeError, "address"):
        flockstep.connect(5)


def test_every_operation_of_the_protocol_is_in_the_client():
    texts = [path.read_text() for path in (ROOT / "envs/flockstep/client").glob("*.py")]
    named = {*re.findall(r'\bcall\(\s*"(\w+)"|Request\((\w+)=', "".join(texts))}
    known = {name for pair in named for name in pair}
    operations = [field.name for field in pb.Request.DESCRIPTOR.oneofs_by_name["operation"].fields]
    assert len(operations) > 40
    assert [name for name in operations if name not in known] == []


def test_both_clients_have_the_same_operations():
    for blocking, other in ((Client, AsyncClient), (Drone, AsyncDrone)):
        names = {name for name in dir(blocking) if not name.startswith("_")} - {"vector_env"}
        assert names == {name for name in dir(other) if not name.startswith("_")}
        assert all(getattr(blocking, name).__doc__ for name in names)


def test_each_kind_of_stream_is_the_field_of_its_operation():
    fields = {f.name: f.message_type.name for f in pb.Subscribe.DESCRIPTOR.oneofs_by_name["what"].fields}
    operations = {f.name: f.message_type.name for f in pb.Request.DESCRIPTOR.oneofs_by_name["operation"].fields}
    assert {stream: operations[operation] for operation, stream in STREAMED.items()} == fields
    with refused(ValueError, "rate_hz", "nan"):
        Subscription(call("get_fps", nothing), float("nan"), False).request()


def test_keywords_that_change_a_configuration_are_shown():
    shown = inspect.signature(Drone.set_camera_config).parameters
    assert set(changes.CameraChanges.__annotations__) == set(shown) - {"self", "camera"}
    assert (shown["width_px"].annotation, shown["width_px"].default) == ("int | None", None)
    assert "\n        fog_visibility_m\n            Distance at which fog" in AsyncClient.set_light.__doc__


def test_errors_of_a_sensor_are_checked_before_they_are_sent():
    errors = flockstep.RangeErrors(dropout=0.5)
    text = change_json(flockstep.LidarConfig, changes.LidarChanges, {"errors": errors, "hfov_deg": None})
    assert json.loads(text) == {"errors": {name: getattr(errors, name) for name in errors.__match_args__}}
    errors.dropout = np.nan
    for wrong, error in ((errors, ValueError), ({"dropout": 0.5}, TypeError)):
        with refused(error, "errors"):
            change_json(flockstep.LidarConfig, changes.LidarChanges, {"errors": wrong})


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("LidarSettings", "flockstep.LidarConfig"),
        ("CameraSettings", "flockstep.CameraConfig"),
        ("LightSettings", "flockstep.Light"),
        ("Mounting", "ServerInfo.imu_configs"),
        ("Imapct", "Impact"),
    ],
)
def test_former_and_misspelt_names_have_a_hint(name, hint):
    with refused(AttributeError, "'flockstep.client' has no attribute", name, hint):
        getattr(flockstep.client, name)
    with refused(AttributeError, "ServerInfo has no attribute", "imu_mountings", "imu_configs"):
        object.__new__(flockstep.client.ServerInfo).imu_mountings  # noqa: B018


def test_a_list_with_another_statement_is_refused():
    text = schema.SOURCE.read_text()
    assert len(schema.read(text).operations) > 40
    with refused(ValueError, "flockstep.proto", "  map<string, bool> a = 1;"):
        schema.read(text.replace("message Done {}", "message Done {\n  map<string, bool> a = 1;\n}"))
