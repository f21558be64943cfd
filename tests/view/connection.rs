//! Pages that connect, disconnect, connect again, or are refused.

use std::io::{Read, Write};
use std::net::TcpStream;

use crate::browser::visit;
use crate::program::Program;
use crate::relay::Relay;

#[test]
fn pages_share_a_render_and_come_back() {
    let mut program = Program::start(&["--gate", "6.2m..6.5m"]);
    let relay = Relay::to(program.port());
    // As with `ssh -L`, the browser and the program have different ports.
    let url = format!("http://localhost:{}/#{}", relay.port, program.token());
    visit(&url.clone(), async move |page| {
        page.picture_after(0, 4).await;
        page.enter("#gate-to", "6.7").await;
        page.until("document.getElementById('command').textContent.includes('6.2m..6.7m')").await;
        page.picture_after(1, 2).await;

        // After a reload, and in a second tab, the page shows the same settings.
        page.browser.refresh().await.unwrap();
        page.picture_after(1, 2).await;
        assert_eq!(page.value("#gate-to").await, "6.7");
        let first = page.browser.window().await.unwrap();
        let second = page.browser.new_tab().await.unwrap();
        page.browser.switch_to_window(second).await.unwrap();
        page.browser.goto(&url).await.unwrap();
        page.picture_after(1, 2).await;
        page.enter("#gate-to", "6.8").await;
        page.picture_after(2, 2).await;
        page.browser.switch_to_window(first).await.unwrap();
        page.picture_after(2, 2).await;
        assert_eq!(page.value("#gate-to").await, "6.8");

        relay.cut();
        page.until("document.querySelector('.alert.lost')?.textContent.includes('connection to the program is lost')")
            .await;
        let samples = page.run("return document.getElementById('picture').dataset.samples").await;
        relay.mend();
        page.until("document.getElementById('connection').textContent === 'Connected'").await;
        page.until("!document.querySelector('.alert.lost')").await;
        page.until(&format!("document.getElementById('picture').dataset.samples > {}", samples.as_str().unwrap()))
            .await;

        program.interrupt();
        page.until("document.querySelector('.alert.lost')?.textContent.includes('program has ended')").await;
    });
}

#[test]
fn pages_without_the_token_and_of_other_sites_are_refused() {
    let program = Program::start(&["--spp", "2"]);
    let token = program.token();
    let wrong: String = token.chars().rev().collect();
    visit(&program.url.replace(token, &wrong), async move |page| {
        page.until("document.querySelector('.alert.lost')?.textContent.includes('address that the program printed')")
            .await;
        assert_eq!(page.revision().await, 0);
        // The right address in the same tab is enough.
        page.browser.goto(&program.url).await.unwrap();
        page.picture_after(0, 1).await;

        let socket = format!("ws://127.0.0.1:{}/ws", program.port());
        let connect = async || {
            let script = "const socket = new WebSocket(arguments[0]);
                socket.onopen = () => arguments[1]('open');
                socket.onerror = () => arguments[1]('refused');";
            page.browser.execute_async(script, vec![socket.clone().into()]).await.unwrap().json().clone()
        };
        assert_eq!(connect().await, "open");
        page.browser.goto("about:blank").await.unwrap();
        assert_eq!(connect().await, "refused", "a page of another site can connect");
    });
}

/// The status line of the answer to a request.
fn status(port: u16, path: &str, headers: &str) -> String {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n").unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    String::from_utf8(answer.to_vec()).unwrap()
}

#[test]
fn foreign_hosts_and_origins_are_refused() {
    let program = Program::start(&["--spp", "2"]);
    let port = program.port();
    assert_eq!(status(port, "/", &format!("Host: localhost:{port}\r\n")), "HTTP/1.1 200");
    assert_eq!(status(port, "/", &format!("Host: evil.example:{port}\r\n")), "HTTP/1.1 403");
    let socket = |origin: &str| {
        let upgrade =
            "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        write!(stream, "GET /ws HTTP/1.1\r\nHost: localhost:{port}\r\nConnection: Upgrade\r\n{upgrade}{origin}\r\n")
            .unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        String::from_utf8(answer.to_vec()).unwrap()
    };
    assert_eq!(socket(&format!("Origin: http://localhost:{port}\r\n")), "HTTP/1.1 101");
    assert_eq!(socket("Origin: http://evil.example\r\n"), "HTTP/1.1 403");
    assert_eq!(socket(""), "HTTP/1.1 403");
}
