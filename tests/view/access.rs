//! The page without a pointer and for screen readers, and its messages to the console.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::Value;
use thirtyfour::prelude::*;

use crate::browser::{Page, visit};
use crate::program::Program;

/// Describes an element: its id, else its tag and text. A group of radio buttons counts as one control, described by its name.
const NAME: &str =
    "const name = e => e.type === 'radio' ? `${e.name} (choice)` : e.id || `${e.tagName} ${e.textContent.trim()}`;";

#[test]
fn the_keyboard_reaches_every_control() {
    let program = Program::start(&["--gates", "5m..8m/12", "--spp", "2"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        open_all(&page).await;
        let all = names(
            &page
                .run(&format!(
                    "{NAME} return [...document.querySelectorAll('button, input, select, summary, [tabindex]')]
                        .filter(e => e.checkVisibility() && !e.disabled).map(name)"
                ))
                .await,
        );
        assert!(all.len() > 50, "{all:?}");
        let mut reached = BTreeSet::new();
        for _ in 0..20 {
            let mut chain = page.browser.action_chain_with_delay(Some(Duration::ZERO), Some(Duration::ZERO));
            page.run(&format!(
                "{NAME} window.reached = []; window.onfocus ??= null;
                 window.noted ??= (document.addEventListener('focusin', e => window.reached.push(name(e.target))), true)"
            ))
            .await;
            for _ in 0..6 {
                chain = chain.key_down(Key::Tab).key_up(Key::Tab);
            }
            chain.perform().await.unwrap();
            reached.extend(names(&page.run("return window.reached").await));
        }
        let missing: Vec<&String> = all.difference(&reached).collect();
        assert!(missing.is_empty(), "the Tab key does not reach {missing:?}");
        // Arrow keys choose within a group.
        page.find("[value=orbit]").await.send_keys("" + Key::Right).await.unwrap();
        page.until("document.querySelector('[value=fly]').checked").await;
        page.says_nothing().await;
    });
}

#[test]
fn axe_finds_no_fault() {
    let Some(axe) = std::env::var_os("TAUGATE_AXE") else {
        eprintln!("skipped: TAUGATE_AXE does not name the file axe.min.js of axe-core (npm pack axe-core)");
        return;
    };
    let axe = std::fs::read_to_string(axe).unwrap();
    let program = Program::start(&["--gate", "6.2m..6.5m", "--spp", "8"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 4).await;
        page.browser.execute(axe, vec![]).await.unwrap();
        for prepare in [
            "return 0",
            "document.querySelector('[value=many]').click()",
            "document.querySelector('[value=error]').click()",
        ] {
            open_all(&page).await;
            page.run(prepare).await;
            page.until("document.getElementById('phase').textContent === 'Done'").await;
            let script = "axe.run(document).then(found => arguments[0](found.violations.map(v => v.id + ': ' + v.nodes.map(n => n.target))))";
            let faults = page.browser.execute_async(script, vec![]).await.unwrap();
            assert_eq!(faults.json(), &Value::Array(vec![]), "after {prepare}");
        }
        page.says_nothing().await;
    });
}

async fn open_all(page: &Page) {
    page.run("for (const part of document.querySelectorAll('details')) part.open = true").await;
}

fn names(list: &Value) -> BTreeSet<String> {
    list.as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_string()).collect()
}
