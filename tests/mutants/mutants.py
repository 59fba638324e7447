"""Deliberate faults, each of which some test finds; run.py proves it.

They are slips that are easily made in lines that matter: a sign, a cosine, a missing π, a swapped axis, a stale result, a wrong
column, an off-by-one. Change such a line, and its old text here has to follow; write a new formula, and add a fault in it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """One fault: `old`, which occurs exactly once in `file`, becomes `new`.

    file: as in the repository. tests: the test files or pytest node ids that find the fault, as few as will do.
    """

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


_REDUCE = ("tests/gather/test_reduce.py::test_reduction_equals_numpy[raster-8-0]",)
_SPLAT = ("tests/indirect/test_splat.py::test_splatting_equals_numpy[view-smooth]",)

SHADERS = (
    # ---- gather
    Mutant(
        "gradient's sign",
        "shaders/gather/reduce_blocks.frag",
        "G += outerProduct(edge.xyz * nearer, L_b.rgb - L.rgb);",
        "G += outerProduct(edge.xyz * nearer, L.rgb - L_b.rgb);",
        _REDUCE,
    ),
    Mutant(
        "cosine left out of E",
        "shaders/gather/reduce_blocks.frag",
        "out_sums += direction.w * vec4(L.rgb, L.a);",
        "out_sums += direction.w / direction.z * vec4(L.rgb, L.a);",
        _REDUCE,
    ),
    Mutant(
        "Hessian by 2/r² instead of 4/r²",
        "shaders/gather/reduce_blocks.frag",
        "H += 4.0 * nearer * nearer",
        "H += 2.0 * nearer * nearer",
        _REDUCE,
    ),
    Mutant(
        "axes of irradiance vectors swapped",
        "shaders/gather/reduce_blocks.frag",
        "M += outerProduct(direction.xyz * (direction.w / direction.z), L.rgb);",
        "M += outerProduct(direction.yxz * (direction.w / direction.z), L.rgb);",
        _REDUCE,
    ),
    Mutant(
        "directions below the surface counted",
        "shaders/gather/reduce_blocks.frag",
        "if (dot(direction.xyz, g) <= 0.0) continue;",
        "if (dot(direction.xyz, g) <= -2.0) continue;",
        ("tests/gather/test_reduce.py::test_directions_below_the_surface_bring_nothing",),
    ),
    Mutant(
        "bends' axis is the greater one's",
        "shaders/gather/reduce_total.frag",
        "float lesser = middle < 0.0 ? middle + apart : middle - apart",
        "float lesser = middle < 0.0 ? middle - apart : middle + apart",
        _REDUCE,
    ),
    Mutant(
        "record written beside its texel",
        "shaders/lib/table.glsl",
        "vec2 texel = vec2(i % size.x, i / size.x) + 0.5;",
        "vec2 texel = vec2(i % size.x + 1, i / size.x) + 0.5;",
        _REDUCE,
    ),
    Mutant(
        "π left out of what a ray brings",
        "shaders/gather/trace.frag",
        "outgoing_radiance(material, E)",
        "outgoing_radiance(material, PI * E)",
        ("tests/gather/test_analytic.py::test_what_a_texel_sees_of_a_lit_plane",),
    ),
    Mutant(
        "π left out of what a texel brings",
        "shaders/gather/raster_texel.glsl",
        "outgoing_radiance(material, E)",
        "outgoing_radiance(material, PI * E)",
        ("tests/gather/test_analytic.py::test_what_a_texel_sees_of_a_lit_plane",),
    ),
    Mutant(
        "ray through a stratum by equal steps of sinθ",
        "shaders/gather/trace.frag",
        "vec3(sqrt(square.x) * vec2(x.x, y.x), sqrt(1.0 - square.x))",
        "vec3(square.x * vec2(x.x, y.x), sqrt(1.0 - square.x * square.x))",
        ("tests/gather/test_analytic.py::test_parallel_patch[0.5-1.0-trace-64]",),
    ),
    Mutant(
        "far corners of boxes with two axes swapped",
        "shaders/lib/bvh.glsl",
        "vec3(n.y >> 16, n.z & 0xFFFFu, n.z >> 16)",
        "vec3(n.y >> 16, n.z >> 16, n.z & 0xFFFFu)",
        ("tests/gpu/test_bvh.py::test_the_shader_finds_the_same[one]",),
    ),
    Mutant(
        "ray enters a box at its nearest face",
        "shaders/lib/bvh.glsl",
        "<= min(min(t1.x, t1.y), min(t1.z, hit.t))",
        "<= min(min(t0.x, t1.y), min(t1.z, hit.t))",
        ("tests/gpu/test_bvh.py::test_the_shader_finds_the_same[one]",),
    ),
    # ---- records and splats
    Mutant(
        "weight without the square root",
        "shaders/records/weight.glsl",
        "+ sqrt(max(0.0, 1.0 - cosine)), LEAST_ERROR)",
        "+ max(0.0, 1.0 - cosine), LEAST_ERROR)",
        _SPLAT,
    ),
    Mutant(
        "records in front of a pixel count",
        "shaders/records/weight.glsl",
        "abs(dot(apart, n + n_k)) * 0.5 > IN_FRONT * R.y)",
        "abs(dot(apart, n + n_k)) * 0.5 > 99.0 * R.y)",
        _SPLAT,
    ),
    Mutant(
        "light beyond a record's wall",
        "shaders/records/weight.glsl",
        "return max(dot(place, walls.xy), dot(place, walls.zw)) > 1.0;",
        "return max(dot(place, walls.xy), dot(place, walls.xy)) > 1.0;",
        _SPLAT,
    ),
    Mutant(
        "second order without its half",
        "shaders/records/weight.glsl",
        "clamp(0.5 * (curvature.x * along * along",
        "clamp(1.0 * (curvature.x * along * along",
        ("tests/indirect/test_splat.py::test_a_quadratic_field_is_extrapolated_exactly",),
    ),
    Mutant(
        "kernel stops short of zero at the rim",
        "shaders/indirect/splat.frag",
        "float k = cut ? w : w - 1.0 / a;",
        "float k = w;",
        _SPLAT,
    ),
    Mutant(
        "quad too small for its sphere",
        "shaders/indirect/splat.vert",
        "vec2(r * d / sqrt(d * d - r * r))",
        "vec2(0.9 * r)",
        ("tests/indirect/test_splat.py::test_no_quad_cuts_an_ellipse[1.0-grazing]",),
    ),
    Mutant(
        "rank by a share of samples instead of pixels",
        "shaders/records/coverage.frag",
        "max(float(served) / float(SAMPLES * SAMPLES) * (high.x - low.x) * (high.y - low.y), least)",
        "max(float(served) / float(SAMPLES * SAMPLES), least)",
        ("tests/renderer/test_relight.py::test_records_are_ranked_by_the_pixels_that_they_serve",),
    ),
    Mutant(
        "ellipse by bends without the root",
        "shaders/records/record.glsl",
        "vec2 radii = sqrt(square / max(",
        "vec2 radii = (square / max(",
        _SPLAT,
    ),
    Mutant(
        "limit of a radius by the difference instead of its root",
        "shaders/records/radius_limit.frag",
        "at / a * sqrt(adapt / difference)",
        "at / a * (adapt / difference)",
        ("tests/records/test_adapt.py::test_limits_equal_numpy_in_any_order[default]",),
    ),
    Mutant(
        "grid's cell index with two axes swapped on the GPU",
        "shaders/records/point_grid.glsl",
        "int row = (walk.row.y * grid_cells + walk.row.x) * grid_cells;",
        "int row = (walk.row.x * grid_cells + walk.row.y) * grid_cells;",
        ("tests/records/test_adapt.py::test_the_limits_of_many_are_those_of_the_few_near_them",),
    ),
    Mutant(
        "examination asks where there is enough",
        "shaders/indirect/examine.frag",
        "needy += w < tolerance ? 1.0 : 0.0;",
        "needy += w > tolerance ? 1.0 : 0.0;",
        ("tests/indirect/test_examine.py::test_no_pixel_needs_a_record_where_all_have_enough_weight",),
    ),
    Mutant(
        "the best pixel of a tile instead of the worst",
        "shaders/indirect/examine.frag",
        "worst = w < least ? i : worst;",
        "worst = w > least ? i : worst;",
        ("tests/indirect/test_examine.py::test_examination_equals_numpy[size1-0.0-0.0]",),
    ),
    Mutant(
        "upsampling takes every square for a plane",
        "shaders/indirect/upsample.frag",
        "abs(dot(plane.xyz, p.xyz) - plane.w) <= MAX_RISE * pixel * p.w;",
        "abs(dot(plane.xyz, p.xyz) - plane.w) <= 1e9 * pixel * p.w;",
        ("tests/indirect/test_upsample.py::test_an_object_between_four_pixels_of_a_wall_takes_no_light_from_it",),
    ),
    Mutant(
        "surface lookup's weights swapped",
        "shaders/surface_cache/lookup.glsl",
        ": vec3(1.0 - f.x - f.y, f), 0.0);",
        ": vec3(f, 1.0 - f.x - f.y), 0.0);",
        ("tests/surface_cache/test_surface.py::test_a_lookup_is_what_plain_sums_say",),
    ),
    # ---- light and picture
    Mutant(
        "direct light falls off with the distance",
        "shaders/lighting/lights.glsl",
        "dot(falloff.xyz, vec3(1.0, d, d2))",
        "dot(falloff.xyz, vec3(1.0, d2, d))",
        ("tests/lighting/test_direct.py::test_a_lit_plane[True-physical]",),
    ),
    Mutant(
        "spot exponent left out",
        "shaders/lighting/lights.glsl",
        "falloff.w > 0.0 ? pow(max(c, 0.0), falloff.w) : 1.0",
        "falloff.w > 0.0 ? max(c, 0.0) : 1.0",
        ("tests/lighting/test_direct.py::test_a_lit_plane[True-exponent]",),
    ),
    Mutant(
        "shadow test without its bias",
        "shaders/lighting/lights.glsl",
        "const float BIAS = 0.1;",
        "const float BIAS = -0.1;",
        ("tests/lighting/test_direct.py::test_a_sphere_has_no_acne[sun]",),
    ),
    Mutant(
        "light's cosine by the geometric normal alone",
        "shaders/lighting/lights.glsl",
        "max(dot(r.n, l), 0.0) : 0.0;",
        "1.0 : 0.0;",
        ("tests/lighting/test_direct.py::test_a_lit_plane[True-physical]",),
    ),
    Mutant(
        "π left out of what a surface reflects",
        "shaders/lib/material.glsl",
        "material.albedo * INV_PI * E;",
        "material.albedo * E;",
        ("tests/image/test_composite.py::test_blend[0.25-weights1]",),
    ),
    Mutant(
        "a vertex read one channel beside its own",
        "irrsplat/core/vertex_layout.py",
        "_CHANNELS[i % 4] for i in run",
        "_CHANNELS[(i + 1) % 4] for i in run",
        ("tests/gather/test_analytic.py::test_what_a_texel_sees_of_a_lit_plane",),
    ),
    Mutant(
        "filmic curve not divided by its white",
        "shaders/lib/display.glsl",
        "hable(x) / hable(vec3(FILMIC_WHITE))",
        "hable(x)",
        ("tests/image/test_composite.py::test_the_screen_shows_what_the_file_holds[-3.0]",),
    ),
    Mutant(
        "sRGB's threshold on the screen",
        "shaders/lib/display.glsl",
        "step(SRGB_LINEAR_END, c)",
        "step(0.031308, c)",
        ("tests/image/test_composite.py::test_the_screen_shows_what_the_file_holds[-3.0]",),
    ),
    Mutant(
        "normals not turned to the viewer",
        "shaders/lib/normals.glsl",
        "return dot(n, g) < 0.0 ? -n : n;",
        "return n;",
        ("tests/image/test_gbuffer.py::test_surfaces_are_two_sided",),
    ),
)

CORE = (
    # ---- gather and surface cache
    Mutant(
        "hemicube's solid angles without the distance",
        "irrsplat/gather/hemicube.py",
        "4.0 / (w * h) / length**3",
        "4.0 / (w * h) / length**2",
        ("tests/gather/test_hemisphere.py::test_the_table_covers_the_hemisphere[raster-1.0-4]",),
    ),
    Mutant(
        "strata of equal steps in θ",
        "irrsplat/gather/stratified.py",
        "np.arcsin(np.sqrt(np.arange(m + 1) / m))",
        "np.arcsin(np.arange(m + 1) / m)",
        ("tests/gather/test_trace.py::test_a_stratum_s_vector_is_its_integral",),
    ),
    Mutant(
        "edge between elevations without a cosine",
        "irrsplat/gather/stratified.py",
        "np.broadcast_arrays(c * c * s * np.cos(middle), c * c * s * np.sin(middle), -s * s * c)",
        "np.broadcast_arrays(c * s * np.cos(middle), c * s * np.sin(middle), -s * s * c)",
        ("tests/gather/test_trace.py::test_edges_are_ward_and_heckbert_s_sum",),
    ),
    Mutant(
        "π left out of the transport",
        "irrsplat/surface_cache/transport.py",
        "weights = weights * (share / np.pi)[..., None]",
        "weights = weights * share[..., None]",
        ("tests/surface_cache/test_bounces.py::test_a_ray_s_hit_goes_where_it_is_said",),
    ),
    Mutant(
        "geometric series adds what is already there",
        "irrsplat/surface_cache/transport.py",
        "np.float32(1.0 / (1.0 - fade))",
        "np.float32(1.0 / (1.0 + fade))",
        ("tests/surface_cache/test_bounces.py::test_all_bounces_are_the_solution_of_the_equation[0.2]",),
    ),
    Mutant(
        "one bounce too many",
        "irrsplat/surface_cache/transport.py",
        "for made in range(2, most + 1):",
        "for made in range(1, most + 1):",
        ("tests/surface_cache/test_bounces.py::test_as_many_bounces_as_are_asked_for",),
    ),
    # ---- which records are made, drawn, kept and gathered again
    Mutant(
        "chessboard's other colour",
        "irrsplat/indirect/site_selection.py",
        "(rows // spacing + columns // spacing) % 2 == phase",
        "(rows // spacing + columns // spacing) % 2 != phase",
        ("tests/indirect/test_examine.py::test_sites_of_a_round_lie_apart",),
    ),
    Mutant(
        "eviction takes what was seen last",
        "irrsplat/records/eviction.py",
        "np.lexsort((-distance, -cache.views_unseen[numbers]))",
        "np.lexsort((-distance, cache.views_unseen[numbers]))",
        ("tests/records/test_eviction.py::test_records_longest_out_of_view_go_first_and_of_those_the_farthest",),
    ),
    Mutant(
        "eviction takes what is near",
        "irrsplat/records/eviction.py",
        "np.lexsort((-distance, -cache.views_unseen[numbers]))",
        "np.lexsort((distance, -cache.views_unseen[numbers]))",
        ("tests/records/test_eviction.py::test_records_longest_out_of_view_go_first_and_of_those_the_farthest",),
    ),
    Mutant(
        "culling without the spheres' radii",
        "irrsplat/records/culling.py",
        " <= radius)",
        " <= 0.0)",
        ("tests/records/test_culling.py::test_what_is_left_out_would_add_nothing[default]",),
    ),
    Mutant(
        "spheres reach one tile too few",
        "irrsplat/records/culling.py",
        "[np.clip(edge, 0, count - 1).astype(np.intp) for edge in (low, high)]",
        "[np.clip(edge, 0, count - 1).astype(np.intp) for edge in (low + 1, high)]",
        ("tests/records/test_culling.py::test_what_is_hidden_would_add_nothing",),
    ),
    Mutant(
        "point grid's cell index with two axes swapped",
        "irrsplat/records/point_grid.py",
        "(z * self.cells + y) * self.cells + x",
        "(x * self.cells + y) * self.cells + z",
        ("tests/records/test_grid.py::test_cells_are_numbered_along_x_first_and_a_point_on_a_plane_is_above_it",),
    ),
    Mutant(
        "point grid's cell ends one plane too early",
        "irrsplat/records/point_grid.py",
        'np.searchsorted(e, p, side="right")',
        'np.searchsorted(e, p, side="left")',
        ("tests/records/test_grid.py::test_cells_are_numbered_along_x_first_and_a_point_on_a_plane_is_above_it",),
    ),
    Mutant(
        "invalidation raises no epoch",
        "irrsplat/records/record_cache.py",
        "columns, later = dict(self._columns), self.invalidation_epoch + 1",
        "columns, later = dict(self._columns), self.invalidation_epoch",
        ("tests/renderer/test_relight.py::test_renewed_in_place_is_gathered_from_scratch[moved-1]",),
    ),
    Mutant(
        "records gathered again stay stale",
        "irrsplat/records/record_cache.py",
        '        columns["epoch"][numbers] = self.invalidation_epoch\n        self._stale = None\n',
        '        columns["epoch"][numbers] = self.invalidation_epoch\n',
        ("tests/renderer/test_relight.py::test_renewed_in_place_is_gathered_from_scratch[moved-1]",),
    ),
    Mutant(
        "refresh order by waiting alone",
        "irrsplat/records/refresh_order.py",
        "-served * waited * cache.drift[stale]",
        "-waited * cache.drift[stale]",
        ("tests/renderer/test_relight.py::test_what_is_seen_most_and_longest_comes_first",),
    ),
    Mutant(
        "vectors do not turn with a moved mesh",
        "irrsplat/records/record_cache.py",
        "texels |= self._rotated(moved.numbers, moved.linear_map)",
        "pass",
        ("tests/renderer/test_move.py::test_a_turned_room_is_the_same_room",),
    ),
    Mutant(
        "moved mesh not noticed",
        "irrsplat/scene/change.py",
        "if a is not b)",
        "if a.name != b.name)",
        ("tests/scene/test_change.py::test_a_change_names_what_moved_and_whether_lights_differ[new4-meshes4-False]",),
    ),
    # ---- caches and files
    Mutant(
        "damaged cache file taken",
        "irrsplat/records/cache_file.py",
        "if hashlib.sha256(data).digest() != digest:",
        "if hashlib.sha256(data).digest() == b'':",
        ("tests/records/test_store.py::test_a_damaged_file_is_refused",),
    ),
    Mutant(
        "cache file of other lights taken",
        "irrsplat/records/cache_file.py",
        "lights=_hash(json.dumps(lights).encode()),",
        "lights=_hash(b''),",
        ("tests/records/test_store.py::test_another_scene_is_refused[light moved]",),
    ),
    Mutant(
        "memo keeps the old result while a stage is made",
        "irrsplat/core/memo.py",
        "        self._made.pop(stage, None)\n        made = make()\n        self._made[stage] = inputs, made\n",
        "        self._made[stage] = inputs, None\n        made = make()\n        self._made[stage] = inputs, made\n",
        ("tests/core/test_memo.py::test_a_stage_that_was_interrupted_is_not_current[KeyboardInterrupt]",),
    ),
    Mutant(
        "view's progress outlives its camera",
        "irrsplat/renderer.py",
        "if state.camera == camera and state.subject == subject:",
        "if state.subject == subject:",
        ("tests/renderer/test_persistence.py::test_turning_the_camera_gathers_few[5.0]",),
    ),
    Mutant(
        "records without values after a failed gather",
        "irrsplat/indirect/record_gatherer.py",
        "                self.cache.truncate(first)  # they hold nothing\n",
        "",
        ("tests/renderer/test_interrupts.py::test_a_gather_that_fails_leaves_no_record_without_values",),
    ),
    Mutant(
        "a failed write leaves its part",
        "irrsplat/core/files.py",
        "        part.unlink(missing_ok=True)\n",
        "        pass\n",
        ("tests/image/test_output.py::test_a_failed_write_leaves_the_old_file_and_no_part[error0-a.png]",),
    ),
    Mutant(
        "sRGB decoded without its straight part",
        "irrsplat/core/color.py",
        "values <= c.encoded_end",
        "values <= 0.0",
        ("tests/scene/test_assets.py::test_ply_vertex_colours_become_linear",),
    ),
    Mutant(
        "overhead of batches not counted",
        "irrsplat/gpu/time_budget.py",
        "(n + batches * self._overhead) / t - self._overhead if batches else 1.0",
        "n / t if batches else 1.0",
        ("tests/gpu/test_time_budget.py::test_a_tick_is_filled_and_not_overrun",),
    ),
    Mutant(
        "a tick's reserve is spent",
        "irrsplat/gpu/time_budget.py",
        "share * (self.left - reserve)",
        "share * self.left",
        ("tests/gpu/test_time_budget.py::test_a_part_keeps_the_reserve_but_has_a_fifth_of_the_tick[0.5-40.0-30.0]",),
    ),
    Mutant(
        "the slower gather is taken",
        "irrsplat/gather/autotune.py",
        "return times[0] <= times[1]",
        "return times[0] >= times[1]",
        ("tests/gather/test_choice.py::test_the_faster_one_is_taken_and_stays",),
    ),
    Mutant(
        "shadow maps outlive the lights",
        "irrsplat/renderer.py",
        "return self.scene.lights, self.scene.meshes, self.settings.shadow_size",
        "return self.scene.meshes, self.settings.shadow_size",
        ("tests/renderer/test_live.py::test_a_moved_light_is_a_fresh_render_s",),
    ),
    Mutant(
        "radius read from the wrong column",
        "irrsplat/records/record_cache.py",
        'record_layout.pack(texels, "radius", values[:, 3])',
        'record_layout.pack(texels, "radius", values[:, 2])',
        ("tests/records/test_cache.py::test_records_come_back_in_their_order[parts0]",),
    ),
    Mutant(
        "last row of a table not read",
        "irrsplat/gpu/texel_table.py",
        "low, high = first // width, -(-last // width)",
        "low, high = first // width, last // width",
        ("tests/gpu/test_texel_table.py::test_what_is_written_lies_where_it_belongs[1]",),
    ),
    Mutant(
        "weight on the CPU without the square root",
        "irrsplat/records/weight.py",
        "distance + np.sqrt(np.maximum(0.0, 1.0 - cosine))",
        "distance + np.maximum(0.0, 1.0 - cosine)",
        ("tests/indirect/test_paper.py::test_weights_on_the_cpu_are_those_of_the_gpu[settings0]",),
    ),
    # ---- what is shown
    Mutant(
        "pictures stand on their heads",
        "irrsplat/gpu/target.py",
        "texture.components)[::-1]",
        "texture.components)",
        ("tests/gpu/test_target.py::test_the_top_row_comes_first",),
    ),
    Mutant(
        "exposure darkens",
        "irrsplat/image/tonemap.py",
        "np.float32(2.0**exposure)",
        "np.float32(2.0**-exposure)",
        ("tests/image/test_composite.py::test_the_screen_shows_what_the_file_holds[-3.0]",),
    ),
    Mutant(
        "samples from the pixel's corner on",
        "irrsplat/image/jitter.py",
        "return (x + 0.5) % 1.0 - 0.5,",
        "return x,",
        ("tests/image/test_antialias.py::test_the_first_sample_is_the_centre_and_so_many_fill_the_pixel_evenly",),
    ),
    Mutant(
        "sample's camera shifted the other way",
        "irrsplat/image/jitter.py",
        "matrix[:2, 2] -= 2.0",
        "matrix[:2, 2] += 2.0",
        ("tests/image/test_antialias.py::test_the_camera_beside_sees_at_the_centre_what_the_camera_saw_off_it[offset1]",),
    ),
    Mutant(
        "limits of radii kept with other settings",
        "irrsplat/records/adaptive_radius.py",
        "same = inputs == done.inputs",
        "same = done.inputs is not None",
        ("tests/records/test_adapt.py::test_turned_off_and_on_again",),
    ),
)

SCENES = (
    Mutant(
        "transform of a glTF node transposed",
        "irrsplat/scene/io/assets.py",
        "matrix=np.asarray(matrix, float),",
        "matrix=np.asarray(matrix, float).T,",
        ("tests/scene/test_assets.py::test_gltf_node_transforms_apply_to_points_and_normals",),
    ),
    Mutant(
        "camera path's spline misses its keys",
        "irrsplat/scene/camera_path.py",
        "2 - 5 * t**2 + 3 * t**3",
        "2 - 5 * t**2 + 2 * t**3",
        ("tests/scene/test_camera_path.py::test_straight_uniform_motion_stays_so",),
    ),
    Mutant(
        "field of view taken for horizontal",
        "irrsplat/scene/model.py",
        "[f / aspect, 0.0, 0.0, 0.0],\n                [0.0, f, 0.0, 0.0],",
        "[f, 0.0, 0.0, 0.0],\n                [0.0, f * aspect, 0.0, 0.0],",
        ("tests/image/test_gbuffer.py::test_a_plane_is_where_the_rays_meet_it[wide]",),
    ),
    Mutant(
        "form factor of a moved mesh without π",
        "irrsplat/records/motion.py",
        "np.pi * square / np.float32(area) + 1.0",
        "square / np.float32(area) + 1.0",
        ("tests/renderer/test_move.py::test_what_a_mesh_covers_is_its_form_factor",),
    ),
    Mutant(
        "meshlets at the border of a view left out",
        "irrsplat/scene/meshlets.py",
        "some = (middle >= -reach)",
        "some = (middle >= reach)",
        ("tests/scene/test_meshlets.py::test_what_a_view_may_see_and_what_lies_within_it[0.0]",),
    ),
    Mutant(
        "box of a node without its second child",
        "irrsplat/scene/bvh.py",
        "np.minimum(bounds[:, left[nodes]], bounds[:, left[nodes] + 1])",
        "np.minimum(bounds[:, left[nodes]], bounds[:, left[nodes]])",
        ("tests/gpu/test_bvh.py::test_every_triangle_is_in_one_leaf_and_within_the_boxes_above_it[five]",),
    ),
    Mutant(
        "matrices multiply on the left",
        "irrsplat/scene/io/scene_text.py",
        "self.matrix = self.matrix @ step",
        "self.matrix = step @ self.matrix",
        ("tests/scene/test_text.py::test_matrices_multiply_on_the_right_as_opengl_does",),
    ),
    Mutant(
        "pop keeps the matrix",
        "irrsplat/scene/io/scene_text.py",
        "_, self.matrix = self.stack.pop()",
        "self.stack.pop()",
        ("tests/scene/test_text.py::test_push_and_pop_save_the_matrix_and_not_the_material",),
    ),
    Mutant(
        "rotate turns the other way",
        "irrsplat/scene/io/scene_text.py",
        "matrix[:3, :3] += np.sin(radians) * cross",
        "matrix[:3, :3] -= np.sin(radians) * cross",
        ("tests/scene/test_text.py::test_matrices_multiply_on_the_right_as_opengl_does",),
    ),
    Mutant(
        "spot cutoff taken for radians",
        "irrsplat/lighting/light_table.py",
        "[np.radians(light.spot_cutoff), ",
        "[light.spot_cutoff, ",
        ("tests/lighting/test_direct.py::test_a_lit_plane[True-hard cone]",),
    ),
    Mutant(
        "π left out of OpenGL's diffuse light",
        "irrsplat/lighting/light_table.py",
        "(1.0 if light.physical else np.pi)",
        "1.0",
        ("tests/lighting/test_direct.py::test_a_lit_plane[True-opengl]",),
    ),
    Mutant(
        "texture's index taken for the normal's",
        "irrsplat/scene/io/obj.py",
        "table[:, :, -1], normals",
        "table[:, :, 1], normals",
        ("tests/scene/test_text.py::test_face_forms_polygons_and_negative_indices",),
    ),
    Mutant(
        "negative indices off by one",
        "irrsplat/scene/io/obj.py",
        "np.where(index < 0, above[at][:, None] + index, index - 1)",
        "np.where(index < 0, above[at][:, None] + index - 1, index - 1)",
        ("tests/scene/test_text.py::test_face_forms_polygons_and_negative_indices",),
    ),
    Mutant(
        "normals transformed as points are",
        "irrsplat/scene/io/mesh_builder.py",
        "np.linalg.inv(matrix[:3, :3]).T",
        "matrix[:3, :3]",
        ("tests/scene/test_text.py::test_normals_follow_the_inverse_transpose",),
    ),
    Mutant(
        "emission taken for the reflectance",
        "irrsplat/scene/io/mtl.py",
        'values.get("Kd", np.full(3',
        'values.get("Ke", np.full(3',
        ("tests/scene/test_assets.py::test_mtl_colours_group_the_faces",),
    ),
)

APP = (
    Mutant(
        "wrong flag exits with 1",
        "app/cli.py",
        "    except InputError as error:\n        return _fail(str(error), 2)",
        "    except InputError as error:\n        return _fail(str(error), 1)",
        ("tests/app/test_cli_errors.py::test_a_wrong_command_line_is_one_line_and_exit_status_2[argv0-COMMAND]",),
    ),
    Mutant(
        "only the last output is written",
        "app/flags.py",
        '"-o", "--output", metavar="OUT", action="append", required=True,',
        '"-o", "--output", metavar="OUT", nargs=1, required=True,',
        ("tests/app/test_cli.py::test_outputs_may_be_repeated_and_restricted",),
    ),
    Mutant(
        "benchmark's ratio upside down",
        "app/bench/compare.py",
        "old['seconds'] / run['seconds']:.2f",
        "run['seconds'] / old['seconds']:.2f",
        ("tests/app/bench/test_ratios.py::test_a_row_says_how_many_times_faster",),
    ),
    Mutant(
        "one frame of a path too many",
        "app/render_path.py",
        "path.frames if stop is None else stop)",
        "path.frames if stop is None else stop + 1)",
        ("tests/app/test_cli_path.py::test_the_frames_are_those_of_a_python_slice[flags2-numbers2]",),
    ),
    Mutant(
        "mouse down looks up",
        "app/viewer/input/free_camera.py",
        "pitch = min(max(pitch - down, -PITCH), PITCH)",
        "pitch = min(max(pitch + down, -PITCH), PITCH)",
        ("tests/app/viewer/test_free_camera.py::test_the_mouse_down_looks_down_and_four_quarters_are_none",),
    ),
    Mutant(
        "key bound to another action",
        "app/viewer/input/keys.py",
        'Key("LEFT_BRACKET", "darker",',
        'Key("LEFT_BRACKET", "brighter",',
        ("tests/app/viewer/test_viewer_keys.py::test_a_key_does_what_it_says[[]",),
    ),
    Mutant(
        "threshold's mark on a linear scale",
        "app/viewer/buffers/weight.py",
        "float(np.log(threshold / low) / np.log(high / low))",
        "float((threshold - low) / (high - low))",
        ("tests/app/viewer/test_buffer_view.py::test_the_threshold_has_its_place_on_the_scale_of_weights[auto]",),
    ),
    Mutant(
        "too dark in the colour of too bright",
        "app/common/error_colours.py",
        "np.where(share > 0.0,",
        "np.where(share < 0.0,",
        ("tests/app/verify/test_verify.py::test_the_colours_of_an_error",),
    ),
    Mutant(
        "noise added to the error instead of taken out",
        "irrsplat/reference/truth.py",
        "math.sqrt(max(rmse**2 - noise**2, 0.0))",
        "math.sqrt(max(rmse**2 + noise**2, 0.0))",
        ("tests/app/verify/test_verify.py::test_the_table",),
    ),
    Mutant(
        "pick reads a row from the bottom",
        "app/viewer/show/screen.py",
        "place=(x, texture.height - 1 - y)",
        "place=(x, y)",
        ("tests/app/viewer/test_record_inspector.py::test_the_record_that_weighs_most_is_picked",),
    ),
    Mutant(
        "preferences not written",
        "app/viewer/preferences.py",
        '        write_text(path, text + "\\n")\n',
        "",
        ("tests/app/viewer/test_preferences.py::test_what_is_saved_comes_back",),
    ),
)

MUTANTS = (*SHADERS, *CORE, *SCENES, *APP)
