"""Pages that connect, disconnect, connect again, or are refused."""

from .page import visit
from .program import view
from .relay import Relay


def test_pages_share_a_render_and_come_back():
    with view("--gate", "6.2m..6.5m") as viewer:
        relay = Relay(viewer.port)
        # As with `ssh -L`, the browser and the program have different ports.
        url = f"http://localhost:{relay.port}/#{viewer.token}"
        with visit(url) as page:
            page.picture_after(0, 4)
            page.enter("#gate-to", "6.7")
            page.until("document.getElementById('command').textContent.includes('6.2m..6.7m')")
            page.picture_after(1, 2)

            # After a reload, and in a second tab, the page shows the same settings.
            page.browser.refresh()
            page.picture_after(1, 2)
            assert page.value("#gate-to") == "6.7"
            first = page.browser.current_window_handle
            page.browser.switch_to.new_window("tab")
            page.browser.get(url)
            page.picture_after(1, 2)
            page.enter("#gate-to", "6.8")
            page.picture_after(2, 2)
            page.browser.switch_to.window(first)
            page.picture_after(2, 2)
            assert page.value("#gate-to") == "6.8"

            relay.cut()
            page.until("document.querySelector('.alert.lost')?.textContent.includes('connection to the program is lost')")
            samples = page.run("return document.getElementById('picture').dataset.samples")
            relay.mend()
            page.until("document.getElementById('connection').textContent === 'Connected'")
            page.until("!document.querySelector('.alert.lost')")
            page.until(f"document.getElementById('picture').dataset.samples > {samples}")

            viewer.interrupt()
            page.until("document.querySelector('.alert.lost')?.textContent.includes('program has ended')")


def test_pages_without_the_token_and_of_other_sites_are_refused():
    with view("--spp", "2") as viewer, visit(viewer.url.replace(viewer.token, viewer.token[::-1])) as page:
        page.until("document.querySelector('.alert.lost')?.textContent.includes('address that the program printed')")
        assert page.revision() == 0
        # The right address in the same tab is enough.
        page.browser.get(viewer.url)
        page.picture_after(0, 1)

        connect = """const socket = new WebSocket(arguments[0]);
            socket.onopen = () => arguments[1]('open');
            socket.onerror = () => arguments[1]('refused');"""
        address = f"ws://127.0.0.1:{viewer.port}/ws"
        assert page.run_later(connect, address) == "open"
        page.browser.get("about:blank")
        assert page.run_later(connect, address) == "refused", "a page of another site can connect"
