"""Messages that other threads send while several pages wait for them."""

import asyncio
import threading

import pytest

from dqcontrol.browser.served_page import LoopEvent, start_server, stop_server

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")


def test_another_thread_leaves_it_alone_and_its_own_wakes_who_waits():
    event, loop = LoopEvent(), asyncio.new_event_loop()

    async def work():
        waiting = asyncio.create_task(event.wait())
        await asyncio.sleep(0)
        thread = threading.Thread(target=event.set)
        thread.start()
        thread.join()
        assert not event.is_set()
        loop.call_soon_threadsafe(event.set)
        assert await asyncio.wait_for(waiting, 20)

    loop.run_until_complete(work())
    loop.close()


def test_servers_of_pages_wait_so_for_what_they_send():
    server = start_server(18490)
    try:
        assert isinstance(server._websock_server.get_message_buffer().message_event, LoopEvent)
        from viser.infra import _infra

        assert isinstance(_infra.AsyncMessageBuffer(asyncio.new_event_loop(), False).message_event, LoopEvent)
    finally:
        stop_server(server)
