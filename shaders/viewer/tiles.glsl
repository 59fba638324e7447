// Tiles of a texture, drawn in rows that begin at the upper left.
uniform vec2 cell;      // size of a tile in texels
uniform int columns;    // tiles per row of the texture
uniform int count;      // number of tiles in use
uniform vec4 place;     // upper left corner in the target, texels per pixel, pixels between tiles
uniform int across;     // tiles per row of the target
uniform vec3 ground;    // display colour around the tiles

// Return the number of the tile at this fragment, and the texel inside it; -1 between tiles.
int tile_at(out ivec2 texel)
{
    vec2 q = vec2(gl_FragCoord.x - place.x, place.y - gl_FragCoord.y) * place.z, pitch = cell + place.w * place.z;
    ivec2 at = ivec2(floor(q / pitch));
    vec2 inside = q - vec2(at) * pitch;
    int i = at.y * across + at.x;
    texel = ivec2(min(vec2(inside.x, cell.y - inside.y), cell - 0.5));
    return at.x < 0 || at.y < 0 || at.x >= across || i >= count || any(greaterThanEqual(inside, cell)) ? -1 : i;
}

// Return the first texel of a tile in the texture.
ivec2 corner_of(int i)
{
    return ivec2(i % columns, i / columns) * ivec2(cell);
}
