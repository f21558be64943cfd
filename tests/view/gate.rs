//! The gate: dragged, typed and played.

use std::time::Duration;

use thirtyfour::prelude::*;

use crate::browser::{Page, visit};
use crate::program::{Program, agree, render, words};
use crate::relay::Relay;

/// The gate in the fields, in metres.
async fn fields(page: &Page) -> [f64; 2] {
    [page.value("#gate-from").await.parse().unwrap(), page.value("#gate-to").await.parse().unwrap()]
}

#[test]
fn the_gate_that_is_dragged_is_rendered() {
    let program = Program::start(&["--gate", "6.2m..6.5m"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        // The time line has its range when the light has been measured.
        page.until("document.querySelector('#gate-preset [value=Median]')").await;
        let before = page.revision().await;
        page.drag("#gate-window", (0, 10), (90, 0)).await;
        page.picture_after(before, 32).await;
        let [from, to] = fields(&page).await;
        assert!(from > 6.5 && (to - from - 0.3).abs() < 1e-6, "{from}..{to}");
        page.pause().await;
        let saved = page.save(&program, "dragged").await;
        let (_folder, reference) = render(&words(&["--gate", &format!("{from}m..{to}m")]));
        assert!(agree(&saved, &reference), "the picture is not that of the gate {from}..{to}");
        page.go_on().await;

        // One end, by pointer and by keyboard.
        page.drag("#gate-end", (-8, 0), (40, 0)).await;
        page.until(&format!("Number(document.getElementById('gate-to').value) > {to} + 0.1")).await;
        assert_eq!(fields(&page).await[0], from);
        let handle = page.find("#gate-begin").await;
        handle.send_keys(Key::Right + Key::Right).await.unwrap();
        page.until(&format!("Number(document.getElementById('gate-from').value) > {from}")).await;
        let narrower = fields(&page).await;
        page.find("#gate-window").await.send_keys("" + Key::PageUp).await.unwrap();
        let width = narrower[1] - narrower[0];
        page.until(&format!("Math.abs(document.getElementById('gate-from').value - {}) < 0.05", narrower[0] + width))
            .await;
        page.says_nothing().await;
    });
}

#[test]
fn presets_set_both_ends_of_the_gate() {
    let program = Program::start(&["--gate", "6.2m..6.5m", "--spp", "4"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        page.until("document.querySelector('#gate-preset [value=Median]')").await;
        page.until("document.getElementById('gate-preset').value === 'As at the start'").await;
        let preset = page.find("#gate-preset").await;
        let mut gates = vec![];
        for (key, name) in [(Key::Home, "First light"), (Key::Down, "Median"), (Key::Down, "Late light")] {
            let before = page.revision().await;
            preset.send_keys("" + key).await.unwrap();
            page.picture_after(before, 1).await;
            page.until(&format!("document.getElementById('gate-preset').value === '{name}'")).await;
            gates.push(fields(&page).await);
        }
        assert!(gates.is_sorted_by(|a, b| a[0] < b[0] && a[1] < b[1]), "{gates:?}");
        // Another gate is no preset.
        page.enter("#gate-to", "20").await;
        page.until("document.getElementById('gate-preset').value === ''").await;
        preset.send_keys("" + Key::End).await.unwrap();
        page.until("document.getElementById('gate-to').value === '6.5'").await;
        assert_eq!(fields(&page).await, [6.2, 6.5]);
        page.says_nothing().await;
    });
}

#[test]
fn named_responses_are_presets_without_a_new_render() {
    let program =
        Program::start(&["--response", "near=box:5m..6m", "--response", "far=gauss:8m..9m,0.1m", "--spp", "4"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        let revision = page.revision().await;
        for (key, number) in [(Key::End, "1"), (Key::Home, "0")] {
            page.find("#gate-preset").await.send_keys("" + key).await.unwrap();
            page.until(&format!("document.getElementById('picture').dataset.response === '{number}'")).await;
        }
        assert_eq!(page.revision().await, revision);
        page.says_nothing().await;
    });
}

#[test]
fn the_gate_is_typed_in_all_units() {
    let program = Program::start(&["--gate", "6.2m..6.5m", "--spp", "4"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        page.enter("#gate-from", "20ns").await;
        page.until("document.getElementById('command').textContent.includes('--gate 5.995')").await;
        page.find("#gate-unit").await.send_keys("n").await.unwrap();
        page.until("document.getElementById('gate-unit').value === 'ns'").await;
        page.enter("#gate-to", "22").await;
        page.until("document.getElementById('command').textContent.includes('--gate 5.99584916m..6.595434076m')").await;
        page.find("#gate-unit").await.send_keys("m d").await.unwrap();
        page.until("document.getElementById('gate-unit').value === 'depth'").await;
        page.enter("#gate-from", "3.1").await;
        page.enter("#gate-width", "0.1").await;
        page.until("document.getElementById('command').textContent.includes('--depth 3.1m..3.2m')").await;

        // A mistake is one sentence, and changes nothing.
        page.enter("#gate-from", "soon").await;
        page.until("document.querySelector('.alert.problem')?.textContent.includes('soon')").await;
        assert_eq!(page.value("#gate-from").await, "3.1");

        page.click("[value=steady]").await;
        page.until("!/--(gate|depth)/.test(document.getElementById('command').textContent)").await;
        let before = page.revision().await;
        page.click("[value=gate]").await;
        page.until("document.getElementById('command').textContent.includes('3.1m..3.2m')").await;
        page.picture_after(before, 1).await;

        // Playing moves the gate.
        page.click("#gate-play").await;
        page.until("Number(document.getElementById('gate-from').value) > 3.18").await;
        page.click("#gate-play").await;
        // Behind the last light, playing begins again with the first light.
        page.enter("#gate-to", "200").await;
        page.enter("#gate-from", "199.9").await;
        page.click("#gate-play").await;
        page.until("Number(document.getElementById('gate-from').value) < 10").await;
        page.click("#gate-play").await;

        // A gate without end gets one from the end of the range.
        page.enter("#gate-to", "inf").await;
        page.until("document.getElementById('gate-width').value === 'inf'").await;
        page.find("#gate-end").await.send_keys("" + Key::Left).await.unwrap();
        page.until("Number(document.getElementById('gate-to').value) < 200").await;

        // The time line has a finest scale.
        page.run(
            "const handle = document.getElementById('gate-begin');
             for (let k = 0; k < 300; k++) handle.dispatchEvent(new KeyboardEvent('keydown', { key: '+', bubbles: true }))",
        )
        .await;
        page.click("#track-all").await;
        page.until("document.getElementById('gate-begin').getAttribute('aria-valuemax') > 5").await;
        page.says_nothing().await;
    });
}

#[test]
fn many_gates_are_scrubbed_without_a_new_render() {
    let program = Program::start(&["--gates", "5m..8m/12", "--spp", "4"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        page.until("document.getElementById('picture').dataset.response > 0").await;
        let revision = page.revision().await;
        let bin = page.find("#gate-bin").await;
        bin.send_keys("" + Key::Home).await.unwrap();
        page.until("document.getElementById('picture').dataset.response === '0'").await;
        bin.send_keys(Key::Right + Key::Right + Key::Right).await.unwrap();
        page.until("document.getElementById('picture').dataset.response === '3'").await;
        assert!(page.text("#gate-text").await.contains("(4 of 12): 5.75–6 m"));
        page.drag("#gate-bin", (0, 0), (0, 0)).await;
        page.click("#gate-play").await;
        page.until("document.getElementById('picture').dataset.response > 6").await;
        page.click("#gate-play").await;
        assert_eq!(page.revision().await, revision);
        page.says_nothing().await;
    });
}

/// Answers arrive 1.5 s late. The answer to one end of the gate arrives after the user has typed the other end.
#[test]
fn a_late_answer_does_not_reset_the_gate() {
    let program = Program::start(&["--gate", "6.2m..6.5m"]);
    let relay = Relay::late(program.port(), Duration::from_millis(1500));
    let url = format!("http://localhost:{}/#{}", relay.port, program.token());
    visit(&url, async move |page| {
        page.picture_after(0, 1).await;
        page.enter("#gate-from", "7").await;
        tokio::time::sleep(Duration::from_millis(1300)).await;
        page.enter("#gate-to", "8").await;
        let start = std::time::Instant::now();
        while start.elapsed() < Duration::from_millis(1400) {
            assert_eq!(fields(&page).await, [7.0, 8.0]);
        }
        page.until("document.getElementById('command').textContent.includes('--gate 7m..8m')").await;
        page.says_nothing().await;
    });
}
