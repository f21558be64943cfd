// A shade point in the form that the importance of tree nodes needs.
#import importance
#import query

// Minimum share of the reflected light that counts as diffuse, because the lobe is only an estimate.
const MIN_DIFFUSE: f32 = 0.1;
// Minimum squared width of a lobe. Light in narrower lobes is found by sensor subpaths, whose MIS weights are then larger.
const MIN_LOBE_WIDTH2: f32 = 0.01;

// The receiver of q: shell, normal and glossy lobe. Light that glass transmits counts as diffusely scattered.
fn make_receiver(q: PathVertex) -> Receiver {
    var r = Receiver(make_shell(q), q.geometric, !is_one_sided(q), q.normal, 1.0, 0.0);
    if (is_in_medium(q)) {
        return medium_receiver(r, q);
    }
    if (HAS_GLOSSY && BY_GLOSS) {
        let b = vertex_bsdf(q);
        let normal = scattering_normal(q, q.to_previous);
        let cosine = dot(normal, q.to_previous);
        let lobes = lobe_probabilities(b, cosine);
        r.mirrored = 2.0 * cosine * normal - q.to_previous;
        // A mirrored direction turns by twice the angle that the normal turns by.
        r.spread = max(4.0 * b.alpha * b.alpha, MIN_LOBE_WIDTH2);
        r.gloss = select(min(lobes.gloss, 1.0 - MIN_DIFFUSE), 0.0, is_delta(b));
        // A receiver has only one lobe. The retroreflector's lobe is kept, because it is narrower in practice.
        if (is_retroreflector(b)) {
            r.mirrored = q.to_previous;
            r.spread = max(4.0 * square(b.retroreflector_alpha), MIN_LOBE_WIDTH2);
            r.gloss = min(b.retroreflection, 1.0 - MIN_DIFFUSE);
        }
    }
    return r;
}

// The receiver of q, an event in a medium. The phase function counts as a glossy lobe around the direction in which the sensor
// subpath travels, or around the opposite direction if it scatters mainly backwards.
fn medium_receiver(receiver: Receiver, q: PathVertex) -> Receiver {
    var r = receiver;
    if (BY_GLOSS) {
        let g = load_medium(q.material).mean_cosine;
        let size = abs(g);
        r.mirrored = select(q.to_previous, -q.to_previous, g >= 0.0);
        r.spread = max(square(1.0 - size) / max(size, 1e-3), MIN_LOBE_WIDTH2);
        r.gloss = min(size, 1.0 - MIN_DIFFUSE);
    }
    return r;
}
