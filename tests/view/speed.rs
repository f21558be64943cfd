//! How fast the page feels: times from an action to the first new picture on the screen.

use crate::browser::{Page, visit};
use crate::program::{Program, scenes};

/// Does `action` and returns the time in ms until a picture of later settings is on the screen.
async fn time(page: &Page, action: &str) -> f64 {
    let script = format!(
        "const done = arguments[0], picture = document.getElementById('picture'), before = picture.dataset.revision, start = performance.now();
         new MutationObserver((_, observer) => {{
             if (picture.dataset.revision === before) return;
             observer.disconnect();
             requestAnimationFrame(() => done(performance.now() - start));
         }}).observe(picture, {{ attributes: true }});
         {action}"
    );
    page.browser.execute_async(script, vec![]).await.unwrap().json().as_f64().unwrap()
}

/// The median time of five actions.
async fn median(page: &Page, action: impl Fn(usize) -> String) -> f64 {
    let mut times = vec![];
    for k in 0..5 {
        times.push(time(page, &action(k)).await);
        tokio::time::sleep(std::time::Duration::from_secs(2)).await;
    }
    times.sort_by(f64::total_cmp);
    times[2]
}

/// Prints the times until the first new picture. Returns the medians after a change of the gate and of the camera in ms; `None`
/// without a browser.
fn answers(scene: &'static str, gate: [f64; 2]) -> Option<[f64; 2]> {
    let flag = format!("{}m..{}m", gate[0], gate[1]);
    let program = Program::of(scene, [512; 2], &["--gate", &flag]);
    let (sender, receiver) = std::sync::mpsc::channel();
    let has_browser = visit(&program.url.clone(), async move |page| {
        page.until("document.getElementById('picture').dataset.size === '512x512'").await;
        // The first load compiled the kernels and prepared the scene, so the time of this second load excludes both.
        page.browser.refresh().await.unwrap();
        page.until("document.getElementById('picture').dataset.revision").await;
        let first = page.run("return performance.now()").await.as_f64().unwrap();
        let width = gate[1] - gate[0];
        let moved = median(&page, |k| {
            format!(
                "const field = document.getElementById('gate-to');
                 field.value = {}; field.dispatchEvent(new Event('change'))",
                gate[1] + 0.3 * width * (k + 1) as f64
            )
        })
        .await;
        let turned = median(&page, |_| {
            "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }))"
                .into()
        })
        .await;
        println!(
            "{scene}: first picture of a page {first:.0} ms; after a change of gate {moved:.0} ms, of camera {turned:.0} ms"
        );
        sender.send([moved, turned]).unwrap();
    });
    has_browser.then(|| receiver.recv().unwrap())
}

#[test]
#[ignore = "needs a machine that does nothing else"]
fn the_page_answers_soon() {
    if let Some([gate, camera]) = answers("cornell-box.glb", [6.2, 6.5]) {
        assert!(gate < 300.0 && camera < 300.0);
    }
}

#[test]
#[ignore = "needs a machine that does nothing else"]
fn the_page_answers_soon_in_large_scenes() {
    for (scene, gate) in [
        ("../../shared/scenes/staircase/scene.glb", [16.0, 16.14]),
        ("../../shared/scenes/city/scene.glb", [24.0, 31.0]),
    ] {
        if !scenes().join(scene).exists() {
            println!("skipped: {scene} is not there");
        } else if let Some([gate, camera]) = answers(scene, gate) {
            assert!(gate < 1000.0 && camera < 1000.0);
        }
    }
}
