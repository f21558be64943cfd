//! An iteration of the full image, during which the engine listens to the pages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use taugate::Result;
use taugate::internals::threads::spawn_scoped;

use super::super::Answers;
use super::super::message::{Change, Report};
use super::super::viewed_scene::{Effect, ViewedScene};
use super::{Command, Engine};

impl Engine {
    /// Renders an iteration of the full image, and listens to the pages meanwhile. Returns whether the iteration was added to the image,
    /// and the effect of the changes that were accepted. Such a change ends the iteration, unless it has no effect. A pause or a wish to
    /// save ends it too if there is an image which that leaves as it is.
    pub(super) fn iterate(&mut self, samples: u32) -> Result<(bool, Option<Effect>)> {
        let full = &mut self.work.renderers.as_mut().expect("the scene is prepared").full;
        // An abandoned iteration of responses may cost their images.
        let keeps_image = full.rendered().iterations > 0 && !full.may_lose_images();
        let stop = Arc::<AtomicBool>::default();
        let abandon = || stop.store(true, Ordering::SeqCst);
        let mut total = None;
        let sender = &self.sender;
        thread::scope(|scope| {
            let iteration = spawn_scoped(scope, "iteration", || {
                // Even after a panic.
                let _over = OnDrop(|| drop(sender.send(Command::IterationOver)));
                full.iterate_unless(samples, &stop)
            })?;
            while let Ok(command) = self.inbox.recv() {
                match command {
                    Command::IterationOver => break,
                    Command::Set { changes, number, page } if self.waiting.is_empty() => {
                        total = sum(total, change(&mut self.viewed, &changes, &page));
                        self.unanswered.push((page, number));
                        if total.is_some_and(|effect| effect != Effect::Nothing) {
                            abandon();
                        }
                    }
                    Command::Pause(on) => {
                        self.work.paused = on;
                        total = sum(total, Some(Effect::Nothing));
                        if on && keeps_image {
                            abandon();
                        }
                    }
                    // What is saved is the image before later changes, so these wait too.
                    command => {
                        if matches!(command, Command::End) || keeps_image {
                            abandon();
                        }
                        self.waiting.push_back(command);
                    }
                }
            }
            let is_added = iteration.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            Ok((is_added, total))
        })
    }
}

/// Applies changes. Tells the page if they are refused, and returns their effect otherwise.
pub fn change(viewed: &mut ViewedScene, changes: &BTreeMap<String, Change>, page: &Answers) -> Option<Effect> {
    let effect = viewed.change(changes);
    effect.inspect_err(|error| page.send(&Report::Problem { message: error.to_string() })).ok()
}

/// The effect of two changes, each of which may have been refused.
pub fn sum(first: Option<Effect>, second: Option<Effect>) -> Option<Effect> {
    match (first, second) {
        (Some(first), Some(second)) => Some(first.and(second)),
        _ => first.or(second),
    }
}

/// Does something when it is dropped.
struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        self.0();
    }
}
