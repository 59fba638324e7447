"""Faults in GLSL formulas, each with a test that detects it; run.py verifies this.

The faults are typical slips: a sign, a cosine, a missing π, a swapped axis, an off-by-one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# A test or a module of tests, and its detected faults: `name: place`. The place is GLSL that occurs once under shaders/, with the
# fault as «right → wrong». White space matches any white space or none, and … any part of a statement.
TABLE = """
tests/gather/test_textures.py::test_a_fence_below_the_sky_holds_back_its_share
    light passes where it is held back: return opacity «< → >» cutoff;
tests/gather/test_textures.py::test_a_fine_fence_in_a_large_image_does_not_vanish
    a dithered layer inverted: «<= → >=» dither(dither_cell);
tests/gather/test_textures.py::test_E_below_a_quartered_emitter_is_the_sum_of_its_quarters
    emission's texture left out: «material.emission *= texture_mean(…).rgb; → »
tests/gather/test_textures.py::test_what_is_finer_than_a_ray_sees_is_seen_as_its_mean
    level 0 however large the footprint: clamp(texels, 1.0, «side * side → 1.0»)
tests/image/test_composite.py::test_blend
    π left out of what a surface reflects: material.albedo * «INV_PI * → » E;
tests/image/test_composite.py::test_the_screen_shows_what_the_file_holds
    filmic curve not divided by its white: hable(x) «/ hable(vec3(FILMIC_WHITE)) → »
    sRGB's threshold on the screen: step(«SRGB_LINEAR_END → 0.031308», c)
tests/lighting/test_direct.py::test_a_sheet_is_lit_on_the_light_s_side_only
    normals not turned to the viewer: return «dot(n, g) < 0.0 ? -n : n → n»;
tests/lighting/test_direct.py::test_a_lit_plane
    direct light falls off with the distance: dot(falloff.xyz, vec3(1.0, «d, d2 → d2, d»))
    light's cosine left out: facing > 0.0 ? «max(dot(r.n, l), 0.0) → 1.0» : 0.0;
    spot exponent left out: falloff.w > 0.0 ? pow(max(c, 0.0), «falloff.w → 1.0») : 1.0
tests/lighting/test_direct.py::test_a_sphere_has_no_acne
    shadow test with the opposite bias: const float BIAS = « → -»…;
tests/lighting/test_direct.py::test_no_light_leaks_into_the_corners_of_thin_walls
    light from texels that look past the receiver: lit += gap «>= -t.separation → > -1e9» ? vec2(
tests/gather/test_light_samples.py
    emitters that rays meet counted whole: return «rays * cosine / max(rays * cosine + samples * t * t, …) → 1.0»;
    light samples' gradient without the emitter's turning: cosine_l * w - «cosine * m - → » vec3(0.0, 0.0, cosine_l)) / (r2 * r);
    light samples' Hessian by 20/r⁴ in place of 24/r⁴: («6.0 → 5.0» * cosine_l * ww
    light samples' gradient without moving shadows: V * df «+ f * vec3(dV, 0.0) → »
tests/gather/test_virtual_lights.py
    spots of lamps that rays meet counted whole: return «1.0 - samples / max(hit_density + samples, …) → 1.0»;
    one set of virtual lights for all records: «min(int(receiver.shift.x * float(sets)), sets - 1) → 0»
tests/gather/test_reduce.py::test_reduction_equals_numpy
    gradient's sign: G += outerProduct(edge.xyz * nearer, «L_b.rgb - L.rgb → L.rgb - L_b.rgb»);
    cosine left out of E: out_sums += direction.w « → / direction.z» * vec4(L.rgb, L.a);
    Hessian by 2/r² in place of 4/r²: H += «4.0 → 2.0» * nearer * nearer
    axes of irradiance vectors swapped: M += outerProduct(«direction.xyz → direction.yxz» * (…), L.rgb);
    Hessian's axis of the greater eigenvalue: mean < 0.0 ? mean «+ half_gap : mean - → - half_gap : mean +» half_gap
    record written beside its texel: vec2 texel = vec2(i % size.x « → + 1», i / size.x) + 0.5;
tests/gather/test_analytic.py::test_directions_below_the_geometric_surface_count_as_nothing
    directions below the surface counted: dot(texel_at(rays, texel).xyz, g) > «0.0 → -2.0» ? 1.0 : 0.0
tests/gather/test_analytic.py::test_what_a_texel_sees_of_a_lit_plane
    π left out of what a ray brings: vec3 L = outgoing_radiance(material, « → PI *» E);
    π left out of what a texel brings: vec4(outgoing_radiance(material, « → PI *» E), max(length(to_hit), …));
tests/gpu/test_bvh.py::test_the_shader_finds_the_same
    far corners of boxes with two axes swapped: vec3(n.y >> 16, «n.z & 0xFFFFu, n.z >> 16 → n.z >> 16, n.z & 0xFFFFu»)
    ray enters a box at its nearest face: <= min(min(«t1.x → t0.x», t1.y), min(t1.z, hit.t))
tests/indirect/test_splat.py::test_splatting_equals_numpy
    weight without the square root: + «sqrt → »(max(0.0, 1.0 - cosine)), LEAST_ERROR)
    records in front of a pixel count: abs(dot(offset, n + n_k)) * 0.5 > «IN_FRONT → 99.0» * R.y)
    kernel stops short of zero at the rim: (hessian ? w « - least → » : w)
    ellipse without the root: vec2 radii = «sqrt → »(square / max(
    quad too small for its sphere: vec2(«r * d / sqrt(d * d - r * r) → 0.9 * r»)
tests/indirect/test_splat.py::test_a_quadratic_field_is_extrapolated_exactly
    second order without its half: clamp(«0.5 → 1.0» * (curvature.x * along * along
tests/records/test_adapt.py::test_limits_equal_numpy_in_any_order
    limit of a radius by the difference in place of its root: distance / a * «sqrt → »(adapt / difference)
tests/records/test_adapt.py::test_the_limits_of_many_are_those_of_the_few_near_them
    bisection for the first compared record reversed: bool below = neighbour_at(middle)[axes.x] «< → >» least;
tests/indirect/test_examine.py::test_examination_equals_numpy
    the best pixel of a tile in place of the worst: worst = w «< → >» least ? i : worst;
tests/surface_cache/test_surface.py::test_a_lookup_is_what_plain_sums_give
    surface lookup's weights swapped: : vec3(«1.0 - f.x - f.y, f → f, 1.0 - f.x - f.y»), 0.0);
"""
EDIT = re.compile("«(.*?) ?→ ?(.*?)»")


@dataclass(frozen=True)
class Mutant:
    """One fault of TABLE."""

    test: str
    name: str
    place: str

    def made(self, shaders: Path) -> Iterator[tuple[Path, str]]:
        """Yield each file with a match of the place, and its text with the fault; once for each match."""
        before, right, wrong, after = EDIT.split(self.place)
        pattern = re.compile("".join(f"({expression(text)})" for text in (before, right, after)))
        for file in sorted(path for path in shaders.rglob("*") if path.is_file()):
            text = file.read_text(encoding="utf-8")
            for match in pattern.finditer(text):
                yield file, f"{text[: match.end(1)]} {wrong} {text[match.end(2) :]}"


def expression(text: str) -> str:
    """Return the regular expression of GLSL, with the white space before it."""
    return "".join(r"[^;{}]*?" if token == "…" else rf"\s*{re.escape(token)}" for token in re.findall(r"\w+|\S", text))


def mutants() -> Iterator[Mutant]:
    """Yield the faults of TABLE."""
    test = ""
    for line in TABLE.strip().splitlines():
        if line.startswith(" "):
            yield Mutant(test, *line.strip().split(": ", 1))
        else:
            test = line


MUTANTS = tuple(mutants())
