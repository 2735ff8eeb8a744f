"""Connections of `flockstep.connect` and `flockstep.connect_async`, with servers that do what real ones seldom do."""

import asyncio
import gc
import socket
import ssl
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from clients import eventually, in_thread
from messages import refused
from scripted_server import WELCOME, certificate, greeted, serving, serving_hello_only

import flockstep
from flockstep.client import ServerError
from flockstep.client import protocol as pb

DONE = pb.Reply(done=pb.Done())
LOCATION = pb.Reply(location=pb.Vector3(x=1, y=2, z=3))


def test_hello_and_a_call(connect):
    def script(s):
        hello = s.answer(WELCOME).hello
        assert (hello.protocol, hello.token) == (2, "secret")
        assert s.answer(LOCATION).get_location.drone == 4
        s.wait_for_close()

    with serving(script) as address, connect(address, token="secret") as client:
        info = client.info
        assert (info.version, info.client, info.num_drones, info.lidars) == ("0.0.0", 7, 6, ("a",))
        location = client.drone(4).get_location()
        assert location.dtype == np.float32
        assert location.tolist() == [1, 2, 3]


def test_unix_sockets(connect, tmp_path):
    path = tmp_path / "socket"
    with refused(ConnectionError, "no server at unix", "serve RECIPE", "No such file"):
        connect(f"unix:{path}")

    with serving(greeted(lambda s: s.answer(DONE)), path) as address, connect(address) as client:
        client.ping()


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


def test_nobody_listens(connect):
    port = free_port()
    with refused(ConnectionError, f"no server at 127.0.0.1:{port}", "python -m flockstep serve"):
        connect(f"127.0.0.1:{port}")
    with refused(ConnectionError, "no host", "no-such-host.invalid"):
        connect("no-such-host.invalid")


def test_a_server_that_comes_later(connect):
    port, is_over = free_port(), threading.Event()

    def serve():
        time.sleep(0.5)
        with serving(greeted(), port=port):
            is_over.wait(20)

    thread = in_thread(serve)
    begun = time.monotonic()
    with connect(f"127.0.0.1:{port}", retry_s=20) as client:
        assert client.info.client == 7
    assert time.monotonic() - begun >= 0.4
    is_over.set()
    thread.join()


def test_something_else_listens(connect):
    for answer in (b"SSH-2.0-OpenSSH\r\n", b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", b""):
        with socket.create_server(("127.0.0.1", 0)) as listener:

            def serve(listener=listener, answer=answer):
                other, _ = listener.accept()
                with other:
                    other.recv(1000)
                    other.sendall(answer)

            thread = in_thread(serve)
            with pytest.raises(ConnectionError, match=r"is not a flockstep server|is gone"):
                connect(f"127.0.0.1:{listener.getsockname()[1]}")
            thread.join()


def test_a_server_that_says_nothing(connect):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with refused(TimeoutError, f"127.0.0.1:{port}"):
            connect(f"127.0.0.1:{port}", timeout_s=0.2)
    with serving(lambda s: (s.receive(), s.wait_for_close())) as address, refused(TimeoutError, "hello", 0.2):
        connect(address, timeout_s=0.2)


def test_a_wrong_token(connect):
    def script(s):
        s.answer(pb.Reply(error=pb.Error(code=pb.Code.UNAUTHENTICATED, text="token: wrong")))
        s.connection.close(1008, "refused")

    with serving(script) as address, refused(ServerError, "token", "wrong", "pass the server's token") as caught:
        connect(address)
    assert (caught.value.code, caught.value.operation) == ("UNAUTHENTICATED", "hello")


def test_another_version_of_the_protocol(connect):
    def script(s):
        s.answer(pb.Reply(welcome=pb.Welcome(protocol=3, version="9.0.0")))
        s.wait_for_close()

    with serving(script) as address, refused(ServerError, "flockstep 9.0.0", 3, 2):
        connect(address)


def test_refusals_leave_the_connection_open(connect):
    def script(s):
        s.answer(pb.Reply(error=pb.Error(code=pb.Code.NOT_FOUND, text="drone: expected 0, got 9")))
        s.answer(LOCATION)
        for rest in (b"\x7a\x00", b"\x22\x02\x08\x63"):  # field 15: config; the code 99
            header = pb.Reply(id=s.receive().id).SerializeToString() + rest
            s.connection.send(len(header).to_bytes(4, "little") + header)

    with serving(greeted(script)) as address, connect(address) as client:
        with refused(ServerError, "drone", 9) as caught:
            client.drone(9).get_location()
        assert (caught.value.code, caught.value.operation) == ("NOT_FOUND", "get_location")
        assert client.drone(0).get_location()[0] == 1
        with refused(ConnectionError, "get_location", "config", "location"):
            client.drone(0).get_location()
        with pytest.raises(ServerError) as caught:
            client.drone(0).get_location()
        assert caught.value.code == "CODE_99"


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (lambda connection: connection.close(1001, "the server stops"), "closed the connection: the server stops"),
        (lambda connection: connection.socket.shutdown(socket.SHUT_RDWR), "is gone"),
    ],
    ids=["told", "gone"],
)
def test_the_server_ends_the_session(connect, end, said):
    with serving(greeted(lambda s: (s.receive(), end(s.connection)))) as address, connect(address) as client:
        for _ in range(2):
            with refused(ConnectionError, f"the server at {address} {said}"):
                client.ping()
        assert said in repr(client)


def test_the_reason_of_the_end_comes_before_a_broken_pipe(connect):
    def script(s):
        s.answer(WELCOME)
        s.connection.close(1001, "out of fuel")

    with serving(script) as address, connect(address) as client:
        time.sleep(0.3)
        for _ in range(2):
            with refused(ConnectionError, "out of fuel"):
                client.restore(bytes(20_000_000))


def test_a_malformed_message_ends_the_connection(connect):
    def script(s):
        s.receive()
        s.connection.send(b"\xff\xff\xff\xff")

    with serving(greeted(script)) as address, connect(address) as client, refused(ConnectionError, "malformed message"):
        client.ping()


def test_late_replies_are_dropped(connect):
    def script(s):
        late, request = s.receive().id, s.receive()
        s.send(late, pb.Reply(location=pb.Vector3(x=9)))
        s.send(request.id, LOCATION)

    with serving(greeted(script)) as address, connect(address, timeout_s=0.3) as client:
        with refused(TimeoutError, "get_location", address, 0.3):
            client.drone(0).get_location()
        assert client.drone(0).get_location()[0] == 1


def test_a_closed_client(connect):
    with serving(greeted()) as address:
        client = connect(address)
        for _ in range(2):
            client.close()
        with refused(ConnectionError, "this client is closed"):
            client.ping()


def test_reconnecting(connect):
    count = iter(range(1, 10))

    def script(s):
        number = next(count)
        s.answer(pb.Reply(welcome=pb.Welcome(protocol=2, client=number)))
        if number == 1:
            s.receive()
            s.connection.close(1001, "restart")
            return
        s.answer(LOCATION)
        s.wait_for_close()

    with serving(script) as address, connect(address) as client:
        drone = client.drone(3)
        with refused(ConnectionError, "restart"):
            drone.get_location()
        client.reconnect()
        assert client.info.client == 2
        assert drone.get_location()[2] == 3


def test_a_server_that_stops_reading(connect):
    """Calls and close() end, although what they send never leaves this process."""
    with serving_hello_only() as address:
        client = connect(address, timeout_s=0.3)
        for _ in range(2):
            with pytest.raises((TimeoutError, ConnectionError), match=r"within 0.3 s|took longer than 0.3 s"):
                client.restore(bytes(50_000_000))
        started = time.monotonic()
        client.close()
        assert time.monotonic() - started < 10


def test_an_interrupted_request_ends_the_connection(monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with serving_hello_only() as address, flockstep.connect(address) as client:
        monkeypatch.setattr(client._readiness, "wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            client.restore(bytes(50_000_000))
        with refused(ConnectionError, "this client was interrupted within a request"):
            client.ping()


def test_large_messages(connect):
    big = np.random.default_rng(0).integers(0, 256, (3_000_001,), np.uint8)

    def script(s):
        s.answer(DONE)
        assert s.values == big.tobytes()
        s.answer(DONE, snapshot=big)

    with serving(greeted(script)) as address, connect(address) as client:
        client.restore(big.tobytes())
        assert client.snapshot() == big.tobytes()


def test_streams(connect):
    go = threading.Event()

    def script(s):
        request = s.receive()
        asked = request.subscribe
        assert (asked.rate_hz, asked.only_new, list(asked.arrays.names)) == (50, True, ["position"])
        for step in range(5):
            s.send(request.id, pb.Reply(time=pb.Time(step=step)), position=np.full((6, 3), step, np.float32))
        s.answer(LOCATION)
        go.wait(10)
        s.send(request.id, pb.Reply(time=pb.Time(step=9, time_s=0.5)), position=np.zeros((6, 3), np.float32))
        stop = s.receive()
        assert stop.unsubscribe.stream == request.id
        s.send(request.id, pb.Reply(time=pb.Time(step=10)), position=np.zeros((6, 3), np.float32))  # on its way
        s.send(stop.id, DONE)
        s.answer(LOCATION)

    with serving(greeted(script)) as address, connect(address) as client:
        stream = client.subscribe_arrays(["position"], rate_hz=50, only_new=True)
        assert client.drone(0).get_location()[0] == 1  # with five values before it, of which the newest stays
        first = next(iter(stream))
        assert (first.time.step, first["position"].shape, list(first)) == (4, (6, 3), ["position"])
        assert (first["position"] == 4).all()
        with refused(TimeoutError, "get_arrays", "no reply"):
            stream.receive(timeout_s=0.1)
        go.set()
        assert stream.receive(timeout_s=10).time == (9, 0.5, 0, 0)
        for _ in range(2):
            stream.close()
        assert list(stream) == []
        with refused(ValueError, "the stream is closed"):
            stream.receive()
        assert client.drone(0).get_location()[0] == 1


def test_streams_that_the_server_ends(connect):
    def script(s):
        s.answer(pb.Reply(error=pb.Error(code=pb.Code.INVALID_ARGUMENT, text="names: no")))
        s.answer(pb.Reply(fps=pb.Fps(fps=5)))
        s.connection.close(1001, "bye")

    with serving(greeted(script)) as address, connect(address) as client:
        stream = client.subscribe_arrays(["a"])
        with refused(ServerError, "names", "no"):
            next(stream)
        with refused(ConnectionError, "stream has ended"):
            next(stream)
        stream.close()
        stream = client.subscribe_fps(rate_hz=2)
        assert next(stream).fps == 5
        with refused(ConnectionError, "bye"):
            next(stream)
        stream.close()


def test_tls(connect, tmp_path):
    files = certificate(tmp_path, "127.0.0.1")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*files)
    big = np.arange(100_000, dtype=np.float32)

    with serving(greeted(lambda s: s.answer(DONE, snapshot=big.view(np.uint8))), tls=context) as address:
        with refused(ConnectionError, "is not trusted", "ca_file"):
            connect(f"wss://{address}")
        port = address.partition(":")[2]
        with pytest.raises(ConnectionError, match=r"not trusted: .*(ostname|host name|IP)"):
            connect(f"wss://localhost:{port}", ca_file=files[0])
        with pytest.raises(ConnectionError, match=r"is not a flockstep server|is gone"):
            connect(address, timeout_s=5)
        for host, check in (("127.0.0.1", True), ("localhost", False)):
            with connect(f"wss://{host}:{port}", ca_file=files[0], check_hostname=check) as client:
                assert client.snapshot() == big.tobytes()
    with serving(lambda s: None) as address, refused(ConnectionError, "does not speak TLS"):
        connect(f"wss://{address}", ca_file=files[0])


# --- only the blocking client


def test_threads_share_a_client():
    def script(s):
        for _ in range(400):
            request = s.receive()
            s.send(request.id, pb.Reply(location=pb.Vector3(x=request.get_location.drone)))

    def places(drone):
        return [client.drone(drone).get_location()[0] for _ in range(50)]

    with serving(greeted(script)) as address, flockstep.connect(address) as client, ThreadPoolExecutor(8) as pool:
        assert list(pool.map(places, range(8))) == [[drone] * 50 for drone in range(8)]


def test_a_thread_calls_while_another_waits_for_a_stream():
    def script(s):
        stream = s.receive().id
        for _ in range(20):
            s.answer(LOCATION)
        s.send(stream, pb.Reply(fps=pb.Fps(fps=5)))
        request = s.receive()
        assert request.unsubscribe.stream == stream
        s.send(request.id, DONE)

    values = []
    with serving(greeted(script)) as address, flockstep.connect(address) as client:
        stream = client.subscribe_fps()
        thread = in_thread(lambda: values.extend(stream))
        for _ in range(20):
            client.drone(0).get_location()
        eventually(lambda: values)
        stream.close()
        thread.join(10)
        assert not thread.is_alive()
    assert [value.fps for value in values] == [5]


def test_closing_wakes_a_thread_that_waits():
    def work():
        with refused(ConnectionError, "this client is closed"):
            client.ping()
        woken.append(True)

    woken = []
    with serving(greeted(lambda s: s.receive())) as address:
        client = flockstep.connect(address)
        thread = in_thread(work)
        time.sleep(0.2)
        client.close()
        thread.join(10)
        assert not thread.is_alive()
    assert woken


def test_an_idle_client_answers_pings(monkeypatch):
    monkeypatch.setattr("flockstep.client.sync_client._ATTEND_S", 0.05)

    def script(s):
        assert s.connection.ping().wait(10)
        s.answer(LOCATION)

    with serving(greeted(script)) as address, flockstep.connect(address) as client:
        time.sleep(0.3)
        assert client.drone(0).get_location()[0] == 1


def test_a_forgotten_client_disconnects():
    def helpers():
        return {thread for thread in threading.enumerate() if thread.name == "flockstep client"}

    before = helpers()  # of earlier tests
    with serving(greeted()) as address:
        client = flockstep.connect(address)
        (helper,) = helpers() - before
        del client
        gc.collect()
    helper.join(10)
    assert not helper.is_alive()


def test_a_slow_reader_gets_the_newest_value():
    def script(s):
        stream = s.receive().id
        for step in range(200):
            s.send(stream, pb.Reply(time=pb.Time(step=step)), position=np.zeros((1000, 3), np.float32))

    with serving(greeted(script)) as address, flockstep.connect(address) as client:
        stream = client.subscribe_arrays(["position"])
        time.sleep(1.0)
        steps = [next(stream).time.step]
        while steps[-1] != 199:
            steps.append(next(stream).time.step)
        assert steps == sorted(steps)
        assert len(steps) < 20


# --- only the asyncio client


def run_async(script, main):
    """Run a coroutine function with a client of a scripted server; return its result."""

    async def run(address):
        async with await flockstep.connect_async(address) as client:
            return await main(client)

    with serving(greeted(script)) as address:
        return asyncio.run(run(address))


def test_many_requests_in_flight():
    def script(s):
        requests = [s.receive() for _ in range(20)]
        for request in reversed(requests):
            s.send(request.id, pb.Reply(location=pb.Vector3(x=request.get_location.drone)))

    async def main(client):
        return await asyncio.gather(*(client.drone(i).get_location() for i in range(20)))

    locations = run_async(script, main)
    assert [location[0] for location in locations] == list(range(20))


def test_a_cancelled_request_leaves_the_others():
    def script(s):
        for request in (s.receive(), s.receive()):
            s.send(request.id, LOCATION)

    async def main(client):
        task = asyncio.create_task(client.drone(0).get_location())
        await asyncio.sleep(0.1)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return await client.drone(1).get_location()

    assert run_async(script, main)[0] == 1


def test_async_for_ends_when_another_task_closes_the_stream():
    def script(s):
        stream = s.answer(pb.Reply(fps=pb.Fps(fps=5)))
        assert s.answer(DONE).unsubscribe.stream == stream.id

    async def main(client):
        values, stream = [], client.subscribe_fps()

        async def read():
            async for value in stream:
                values.append(value.fps)

        task = asyncio.create_task(read())
        while not values:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.05)
        with refused(RuntimeError, "another task already waits"):
            await stream.receive()
        await stream.close()
        await asyncio.wait_for(task, 10)
        return values

    assert run_async(script, main) == [5]
