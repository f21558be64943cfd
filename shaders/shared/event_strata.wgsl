// Events of a histogram in fog (fog.wgsl). One event on a segment would serve all gates of the histogram. So the range of the gates is
// divided into strata, one for each gate. A sample draws an event in every n-th stratum, where n is the `event_cycle`. The samples of a
// pixel take turns, so n samples together draw one event in each stratum (systematic sampling). Only for rays that are aimed (HAS_AIMS): a camera has few
// samples per pixel, and its error in fog comes from light that is scattered more often (docs/notebook/waveforms.md).
#import random
#import samples
#import vertex

// Number of strata; 1 if events are drawn in the whole range.
override EVENT_STRATA: u32 = 1u;
// The `event_cycle` of first segments.
override EVENT_CYCLE: u32 = 1u;

// Number of events on a segment behind the first one. They carry less light.
const LATER_EVENTS: u32 = 4u;

// Number of events that a sample draws on its first segment for each deterministic vertex. Later segments have at most as many.
fn event_count() -> u32 {
    return (EVENT_STRATA + EVENT_CYCLE - 1u) / EVENT_CYCLE;
}

// Number of samples that together draw one event in each stratum of the segment before q.
fn event_cycle(q: PathVertex) -> u32 {
    let later = max(EVENT_CYCLE, (EVENT_STRATA + LATER_EVENTS - 1u) / LATER_EVENTS);
    return select(later, EVENT_CYCLE, (q.flags & VERTEX_DEPTH) == 1u);
}

// All travel times inside the gate, with an allowance for rounding.
fn whole_gate() -> vec2<f32> {
    return vec2<f32>(frame.gate_lo - frame.rounding_allowance, frame.gate_hi + frame.rounding_allowance);
}

// The stratum of event `number` on the segment before q, or a number of at least EVENT_STRATA if there is no such event. The first turn is
// random, so that each stratum has the same probability in each sample.
fn event_stratum(q: PathVertex, number: u32, sensor: SensorSample) -> u32 {
    let turn = random_words(STREAM_EVENT, sensor.index, q.flags & VERTEX_DEPTH, 0u, 0u, sensor.seed).x + sensor.sample;
    let cycle = event_cycle(q);
    return number * cycle + turn % cycle;
}

// Two uniform numbers that place an event in its `event_gate`; `u` if there are no strata. The events that the samples of a pixel draw in a
// stratum follow the sequence R2 (Roberts 2018) from a random start.
fn event_uniforms(q: PathVertex, number: u32, sensor: SensorSample, u: vec2<f32>) -> vec2<f32> {
    if (EVENT_STRATA == 1u) {
        return u;
    }
    let stratum = event_stratum(q, number, sensor);
    let start = random_words(STREAM_EVENT, sensor.index, q.flags & VERTEX_DEPTH, 1u, stratum, sensor.seed).xy;
    let words = start + vec2<u32>(3242174889u, 2447445414u) * (sensor.sample / event_cycle(q));
    return vec2<f32>(words >> vec2<u32>(8u)) * (1.0 / 16777216.0);
}

// The travel times in which event `number` on the segment before q is drawn. x > y if there is no such event.
fn event_gate(q: PathVertex, number: u32, sensor: SensorSample) -> vec2<f32> {
    if (EVENT_STRATA == 1u) {
        return whole_gate();
    }
    let stratum = event_stratum(q, number, sensor);
    let width = (frame.gate_hi - frame.gate_lo) / f32(EVENT_STRATA);
    let ends = frame.gate_lo + width * vec2<f32>(f32(stratum), f32(stratum + 1u));
    // The allowance belongs to the outer strata.
    let lo = select(ends.x, ends.x - frame.rounding_allowance, stratum == 0u);
    let hi = select(ends.y, frame.gate_hi + frame.rounding_allowance, stratum + 1u == EVENT_STRATA);
    return select(vec2<f32>(0.0, -1.0), vec2<f32>(lo, hi), stratum < EVENT_STRATA);
}
