//! Makes the pictures of the page for README and guide; `docs/pictures/make.sh` runs this.

use std::path::PathBuf;
use std::time::Duration;

use thirtyfour::prelude::*;

use crate::browser::{Page, visit};
use crate::program::Program;

const WINDOW: (u32, u32) = (1280, 930);
/// The render may take this long to reach its target.
const PATIENCE: Duration = Duration::from_secs(600);

/// Writes what the window shows to the folder that TAUGATE_PICTURES names, when relMSE is below the target.
async fn take(page: &Page, name: &str, target: &str) {
    page.enter("#target", target).await;
    page.until_within(PATIENCE, "document.getElementById('target-time').textContent === 'reached'").await;
    page.pause().await;
    let folder = PathBuf::from(std::env::var_os("TAUGATE_PICTURES").expect("TAUGATE_PICTURES names a folder"));
    page.browser.screenshot(&folder.join(name)).await.unwrap();
}

async fn open(page: &Page) {
    page.browser.set_window_rect(0, 0, WINDOW.0, WINDOW.1).await.unwrap();
    page.until("document.getElementById('picture').dataset.revision").await;
    page.until(
        "document.querySelector('#gate-preset [value=Median]') || document.querySelector('[value=many]').checked",
    )
    .await;
}

#[test]
#[ignore = "makes pictures and tests nothing"]
fn pictures_of_one_gate_and_of_many() {
    let program = Program::of("cornell-box.glb", [512, 512], &["--gate", "6.2m..6.5m"]);
    visit(&program.url.clone(), async move |page| {
        let _program = program;
        open(&page).await;
        page.drag("#stage", (60, -20), (0, 0)).await;
        take(&page, "view.png", "0.03").await;
    });
    let program = Program::of("street.glb", [640, 360], &["--gates", "20m..80m/30"]);
    visit(&program.url.clone(), async move |page| {
        let _program = program;
        open(&page).await;
        page.click("[value=false]").await;
        // The gate with the car.
        let bin = page.find("#gate-bin").await;
        bin.send_keys("" + Key::Home).await.unwrap();
        for _ in 0..22 {
            bin.send_keys("" + Key::Right).await.unwrap();
        }
        page.drag("#stage", (60, 120), (0, 0)).await;
        take(&page, "view-gates.png", "0.03").await;
    });
}
