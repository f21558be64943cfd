// A shade point as the importance of tree nodes sees it.
#import importance
#import query

// Part of what reflects that counts as diffuse, at least: the lobe is an estimate.
const MIN_DIFFUSE: f32 = 0.1;
// Squared width of a lobe at least: the light of narrower ones is what subpaths find, by their weights.
const MIN_LOBE_WIDTH2: f32 = 0.01;

// Its shell, its normal, and the lobe of its gloss; light that glass lets through counts as what it scatters diffusely.
fn make_receiver(q: PathVertex) -> Receiver {
    var r = Receiver(make_shell(q), q.geometric, !is_one_sided(q), q.normal, 1.0, 0.0);
    if (HAS_GLOSSY && BY_GLOSS) {
        let b = vertex_bsdf(q);
        let cosine = dot(q.normal, q.to_previous);
        let lobes = lobe_probabilities(b, cosine);
        r.mirrored = 2.0 * cosine * q.normal - q.to_previous;
        // A mirrored direction turns by twice the angle of the normal.
        r.spread = max(4.0 * b.alpha * b.alpha, MIN_LOBE_WIDTH2);
        r.gloss = select(min(lobes.gloss, 1.0 - MIN_DIFFUSE), 0.0, is_delta(b));
    }
    return r;
}
