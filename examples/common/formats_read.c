/* Readers of triangle surfaces. */
#include "formats_input.h"

int formats_fail(formats_error *error, const char *path, const char *format, ...) {
    va_list arguments;
    char *text = error->text;
    size_t used;
    snprintf(text, sizeof error->text, "%.200s: ", path);
    used = strlen(text);
    va_start(arguments, format);
    vsnprintf(text + used, sizeof error->text - used, format, arguments);
    va_end(arguments);
    for (; *text; text++)
        if ((unsigned char)*text < ' ') *text = '?'; /* one line, whatever the path or the file holds */
    return 0;
}

/* ---- the surface being read ---- */

typedef struct builder {
    input *in;
    formats_surface surface;
    int vertex_capacity, triangle_capacity;
    int polygon, first, previous, corners; /* the polygon being read */
} builder;

static int add_vertex(builder *b, const double xyz[3]) {
    formats_surface *s = &b->surface;
    void *data = s->vertices;
    if (!input_room(b->in, &data, s->vertex_count, &b->vertex_capacity, 3 * sizeof(double))) return 0;
    s->vertices = (double *)data;
    memcpy(s->vertices + 3 * (size_t)s->vertex_count, xyz, 3 * sizeof(double));
    s->vertex_count++;
    return 1;
}

static int add_triangle(builder *b, int i, int j, int k) {
    formats_surface *s = &b->surface;
    void *data = s->triangles;
    int *triangle;
    if (!input_room(b->in, &data, s->triangle_count, &b->triangle_capacity, 3 * sizeof(int))) return 0;
    s->triangles = (int *)data;
    triangle = s->triangles + 3 * (size_t)s->triangle_count++;
    triangle[0] = i, triangle[1] = j, triangle[2] = k;
    return 1;
}

/* A polygon's corners one by one become a fan around the first. */
static void begin_polygon(builder *b) { b->corners = 0; }

static int add_corner(builder *b, int vertex) {
    b->corners++;
    if (b->corners == 1) b->first = vertex;
    if (b->corners >= 3 && !add_triangle(b, b->first, b->previous, vertex)) return 0;
    b->previous = vertex;
    return 1;
}

static int end_polygon(builder *b) {
    b->polygon++;
    if (b->corners >= 3) return 1;
    return fail_here(b->in, "face %d has %d corners", b->polygon - 1, b->corners);
}

/* ---- OBJ ---- */

/* Vertices may follow the faces that use them: count them first. */
static int obj_count_vertices(input *in) {
    int count = 0;
    for (; find_word(in); next_line(in))
        if (take_word(in, "v") && count < INT_MAX) count++;
    in->at = 0;
    in->line = 1;
    return count;
}

/* One corner of a face: 7, 7/1, 7/1/3 or 7//3; negative counts back from the latest vertex. */
static int obj_corner(builder *b, int vertex_count) {
    input *in = b->in;
    long long index = 0;
    if (!take_integer(in, -(long long)INT_MAX, INT_MAX, &index)) return 0;
    if (index < 0) index += b->surface.vertex_count;
    else index--;
    if (index < 0 || index >= vertex_count)
        return fail_here(in, "face %d: there is no such vertex (there are %d)", b->polygon, vertex_count);
    while (in->at < in->size && !isspace(in->data[in->at]) && in->data[in->at] != '\\') in->at++;
    return add_corner(b, (int)index);
}

static int read_obj(builder *b) {
    input *in = b->in;
    int vertex_count = obj_count_vertices(in);
    for (; find_word(in); next_line(in)) {
        if (take_word(in, "v")) {
            double xyz[3];
            if (!take_number(in, &xyz[0]) || !take_number(in, &xyz[1]) || !take_number(in, &xyz[2])) return 0;
            if (!add_vertex(b, xyz)) return 0;
        } else if (take_word(in, "f")) {
            begin_polygon(b);
            while (!at_line_end(in))
                if (!obj_corner(b, vertex_count)) return 0;
            if (!end_polygon(b)) return 0;
        }
    }
    return 1;
}

/* ---- OFF ---- */

static int read_off(builder *b) {
    input *in = b->in;
    long long vertex_count, face_count, edge_count, i, k, corners, vertex;
    if (!find_word(in) || !(take_word(in, "off") || take_word(in, "coff") || take_word(in, "noff")))
        return fail_here(in, "not an OFF file");
    if (take_word(in, "binary")) return fail_here(in, "binary OFF is not supported");
    if (!find_word(in)) return fail_here(in, "the counts are missing");
    if (!take_integer(in, 0, INT_MAX, &vertex_count) || !take_integer(in, 0, INT_MAX, &face_count)) return 0;
    if (!at_line_end(in) && !take_integer(in, 0, LLONG_MAX, &edge_count)) return 0;
    next_line(in);
    for (i = 0; i < vertex_count; i++, next_line(in)) {
        double xyz[3];
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld vertices", i, vertex_count);
        if (!take_number(in, &xyz[0]) || !take_number(in, &xyz[1]) || !take_number(in, &xyz[2])) return 0;
        if (!add_vertex(b, xyz)) return 0;
    }
    for (i = 0; i < face_count; i++, next_line(in)) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld faces", i, face_count);
        if (!take_integer(in, 0, INT_MAX, &corners)) return 0;
        begin_polygon(b);
        for (k = 0; k < corners; k++)
            if (!take_integer(in, 0, vertex_count - 1, &vertex) || !add_corner(b, (int)vertex)) return 0;
        if (!end_polygon(b)) return 0;
    }
    return 1;
}

/* ---- PLY ---- */

typedef enum ply_type {
    PLY_INT8,
    PLY_UINT8,
    PLY_INT16,
    PLY_UINT16,
    PLY_INT32,
    PLY_UINT32,
    PLY_FLOAT,
    PLY_DOUBLE
} ply_type;

typedef enum ply_role { PLY_SKIPPED, PLY_X, PLY_Y, PLY_Z, PLY_CORNERS } ply_role;

typedef struct ply_property {
    ply_type type;
    int is_list;
    ply_type count_type; /* of a list */
    ply_role role;
} ply_property;

enum { PLY_MAX_ELEMENTS = 16, PLY_MAX_PROPERTIES = 64 };

typedef struct ply_element {
    long long count;
    int is_vertex, is_face, property_count;
    ply_property properties[PLY_MAX_PROPERTIES];
} ply_element;

typedef struct ply_header {
    int is_ascii, is_big_endian, element_count;
    ply_element elements[PLY_MAX_ELEMENTS];
} ply_header;

static const int ply_sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};

static int ply_take_type(input *in, ply_type *out) {
    static const char *const names[][2] = {{"char", "int8"},     {"uchar", "uint8"},   {"short", "int16"},
                                           {"ushort", "uint16"}, {"int", "int32"},     {"uint", "uint32"},
                                           {"float", "float32"}, {"double", "float64"}};
    int i;
    for (i = 0; i < 8; i++)
        if (take_word(in, names[i][0]) || take_word(in, names[i][1])) {
            *out = (ply_type)i;
            return 1;
        }
    return fail_here(in, "unknown type of a property");
}

static int ply_read_property(input *in, ply_header *header) {
    ply_element *element;
    ply_property *property;
    if (header->element_count == 0) return fail_here(in, "a property before any element");
    element = &header->elements[header->element_count - 1];
    if (element->property_count == PLY_MAX_PROPERTIES) return fail_here(in, "too many properties");
    property = &element->properties[element->property_count++];
    memset(property, 0, sizeof *property);
    property->is_list = take_word(in, "list");
    if (property->is_list) {
        if (!ply_take_type(in, &property->count_type)) return 0;
        if (property->count_type >= PLY_FLOAT) return fail_here(in, "a list is counted by a whole number");
    }
    if (!ply_take_type(in, &property->type)) return 0;
    if (element->is_vertex && !property->is_list) {
        if (take_word(in, "x")) property->role = PLY_X;
        else if (take_word(in, "y")) property->role = PLY_Y;
        else if (take_word(in, "z")) property->role = PLY_Z;
    }
    if (element->is_face && property->is_list && (take_word(in, "vertex_indices") || take_word(in, "vertex_index"))) {
        if (property->type >= PLY_FLOAT) return fail_here(in, "a vertex index is a whole number");
        property->role = PLY_CORNERS;
    }
    return 1;
}

static int ply_read_element(input *in, ply_header *header) {
    ply_element *element;
    if (header->element_count == PLY_MAX_ELEMENTS) return fail_here(in, "too many elements");
    element = &header->elements[header->element_count++];
    element->is_vertex = take_word(in, "vertex");
    element->is_face = !element->is_vertex && take_word(in, "face");
    if (!element->is_vertex && !element->is_face) {
        skip_blanks(in);
        while (in->at < in->size && !isspace(in->data[in->at])) in->at++;
    }
    return take_integer(in, 0, INT_MAX, &element->count);
}

/* The header's elements carry each role exactly once. */
static int ply_check_roles(const input *in, const ply_header *header) {
    int seen[PLY_CORNERS + 1] = {0}, i, k;
    for (i = 0; i < header->element_count; i++)
        for (k = 0; k < header->elements[i].property_count; k++) seen[header->elements[i].properties[k].role]++;
    if (seen[PLY_X] != 1 || seen[PLY_Y] != 1 || seen[PLY_Z] != 1)
        return formats_fail(in->error, in->path, "the header does not declare one x, y and z of the vertices");
    if (seen[PLY_CORNERS] != 1)
        return formats_fail(in->error, in->path, "the header does not declare one list vertex_indices of the faces");
    return 1;
}

static int ply_read_header(input *in, ply_header *header) {
    memset(header, 0, sizeof *header);
    next_line(in); /* "ply" */
    if (!find_word(in) || !take_word(in, "format")) return fail_here(in, "the line \"format\" is missing");
    if (take_word(in, "ascii")) header->is_ascii = 1;
    else if (take_word(in, "binary_big_endian")) header->is_big_endian = 1;
    else if (!take_word(in, "binary_little_endian")) return fail_here(in, "unknown format");
    for (next_line(in); find_word(in); next_line(in)) {
        if (take_word(in, "end_header")) {
            next_line(in);
            in->is_binary = !header->is_ascii;
            return ply_check_roles(in, header);
        }
        if (take_word(in, "element")) {
            if (!ply_read_element(in, header)) return 0;
        } else if (take_word(in, "property")) {
            if (!ply_read_property(in, header)) return 0;
        } else if (!take_word(in, "comment") && !take_word(in, "obj_info")) {
            return fail_here(in, "unknown line in the header");
        }
    }
    return fail_here(in, "ends within the header");
}

/* One value, from text or bytes. Whole numbers up to 32 bits are exact in a double. */
static int ply_take_value(input *in, const ply_header *header, ply_type type, double *out) {
    unsigned char bytes[8];
    uint64_t bits = 0;
    float single;
    int size = ply_sizes[type], i;
    if (header->is_ascii) {
        if (!find_word(in)) return fail_here(in, "ends too early");
        return take_number(in, out);
    }
    if ((size_t)size > in->size - in->at) return fail_here(in, "ends too early");
    for (i = 0; i < size; i++) bytes[i] = in->data[in->at + (size_t)(header->is_big_endian ? size - 1 - i : i)];
    in->at += (size_t)size;
    for (i = 0; i < size; i++) bits |= (uint64_t)bytes[i] << (8 * i);
    switch (type) {
    case PLY_INT8: *out = bits < 0x80 ? (double)bits : (double)bits - 256.0; break;
    case PLY_INT16: *out = bits < 0x8000 ? (double)bits : (double)bits - 65536.0; break;
    case PLY_INT32: *out = bits < 0x80000000u ? (double)bits : (double)bits - 4294967296.0; break;
    case PLY_UINT8:
    case PLY_UINT16:
    case PLY_UINT32: *out = (double)bits; break;
    case PLY_FLOAT: {
        uint32_t half = (uint32_t)bits;
        memcpy(&single, &half, sizeof single);
        *out = (double)single;
        break;
    }
    case PLY_DOUBLE: memcpy(out, &bits, sizeof *out); break;
    }
    return 1;
}

static int ply_take_property(builder *b, const ply_header *header, const ply_property *property, double xyz[3]) {
    input *in = b->in;
    double value, count = 1;
    int k;
    if (property->is_list && !ply_take_value(in, header, property->count_type, &count)) return 0;
    if (!(count >= 0 && count <= INT_MAX) || count != floor(count)) return fail_here(in, "bad length of a list");
    if (property->role == PLY_CORNERS) begin_polygon(b);
    for (k = 0; k < (int)count; k++) {
        if (!ply_take_value(in, header, property->type, &value)) return 0;
        if (property->role == PLY_SKIPPED) continue;
        if (property->role != PLY_CORNERS) {
            if (!isfinite(value))
                return fail_here(in, "vertex %d: a coordinate is NaN or infinite", b->surface.vertex_count);
            xyz[property->role - PLY_X] = value;
        } else if (!(value >= 0 && value <= INT_MAX) || value != floor(value)) {
            return fail_here(in, "face %d: no such vertex", b->polygon);
        } else if (!add_corner(b, (int)value)) {
            return 0;
        }
    }
    return property->role != PLY_CORNERS || end_polygon(b);
}

static int read_ply(builder *b) {
    ply_header header;
    int i, k;
    long long n;
    if (!ply_read_header(b->in, &header)) return 0;
    for (i = 0; i < header.element_count; i++) {
        const ply_element *element = &header.elements[i];
        if (element->property_count == 0) continue; /* takes no bytes, whatever its count */
        for (n = 0; n < element->count; n++) {
            double xyz[3] = {0, 0, 0};
            for (k = 0; k < element->property_count; k++)
                if (!ply_take_property(b, &header, &element->properties[k], xyz)) return 0;
            if (element->is_vertex && !add_vertex(b, xyz)) return 0;
        }
    }
    return 1;
}

/* ---- STL ---- */

/* Vertices by position: open addressing, at most half full. */
typedef struct weld {
    int *slots; /* vertex or -1 */
    size_t size;
} weld;

static size_t weld_hash(const double xyz[3]) {
    uint64_t bits[3], hash = 0;
    int i;
    memcpy(bits, xyz, sizeof bits);
    for (i = 0; i < 3; i++) {
        hash = (hash ^ bits[i]) * 0x9e3779b97f4a7c15u;
        hash ^= hash >> 29;
    }
    return (size_t)hash;
}

/* The slot of an equal vertex, or the free one where it would go. */
static size_t weld_find(const weld *w, const double *vertices, const double xyz[3]) {
    size_t slot = weld_hash(xyz) & (w->size - 1);
    while (w->slots[slot] >= 0 && memcmp(vertices + 3 * (size_t)w->slots[slot], xyz, 3 * sizeof(double)) != 0)
        slot = (slot + 1) & (w->size - 1);
    return slot;
}

static int weld_grow(weld *w, const builder *b) {
    weld larger;
    size_t i;
    int v;
    larger.size = w->size ? 2 * w->size : 1024;
    larger.slots = (int *)malloc(larger.size * sizeof(int));
    if (!larger.slots) return fail_memory(b->in);
    for (i = 0; i < larger.size; i++) larger.slots[i] = -1;
    for (v = 0; v < b->surface.vertex_count; v++)
        larger.slots[weld_find(&larger, b->surface.vertices, b->surface.vertices + 3 * (size_t)v)] = v;
    free(w->slots);
    *w = larger;
    return 1;
}

static int weld_corner(weld *w, builder *b, double xyz[3]) {
    size_t slot;
    int k;
    for (k = 0; k < 3; k++) {
        if (!isfinite(xyz[k])) return fail_here(b->in, "face %d: a coordinate is NaN or infinite", b->polygon);
        xyz[k] += 0.0; /* -0 becomes 0, so that equal numbers are equal bytes */
    }
    if (w->size < 2 * ((size_t)b->surface.vertex_count + 1) && !weld_grow(w, b)) return 0;
    slot = weld_find(w, b->surface.vertices, xyz);
    if (w->slots[slot] < 0) {
        w->slots[slot] = b->surface.vertex_count;
        if (!add_vertex(b, xyz)) return 0;
    }
    return add_corner(b, w->slots[slot]);
}

static int expect_word(input *in, const char *word) {
    if (find_word(in) && take_word(in, word)) return 1;
    return fail_here(in, "\"%s\" is missing", word);
}

static int read_stl_ascii(builder *b, weld *w) {
    input *in = b->in;
    double xyz[3];
    int k;
    next_line(in); /* "solid name" */
    while (find_word(in)) {
        if (take_word(in, "endsolid") || take_word(in, "solid")) {
            next_line(in);
            continue;
        }
        if (!expect_word(in, "facet")) return 0;
        next_line(in); /* the normal follows from the vertices */
        if (!expect_word(in, "outer") || !expect_word(in, "loop")) return 0;
        begin_polygon(b);
        for (k = 0; k < 3; k++) {
            if (!expect_word(in, "vertex")) return 0;
            if (!take_number(in, &xyz[0]) || !take_number(in, &xyz[1]) || !take_number(in, &xyz[2])) return 0;
            if (!weld_corner(w, b, xyz)) return 0;
        }
        if (!end_polygon(b) || !expect_word(in, "endloop") || !expect_word(in, "endfacet")) return 0;
    }
    return 1;
}

enum { STL_HEADER = 84, STL_FACET = 50 };

static uint32_t little_endian32(const unsigned char *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static int read_stl_binary(builder *b, weld *w) {
    input *in = b->in;
    uint32_t count, n;
    int k, axis;
    in->is_binary = 1;
    if (in->size < STL_HEADER) return fail_here(in, "an STL file has at least %d bytes", STL_HEADER);
    count = little_endian32(in->data + 80);
    if (count > (in->size - STL_HEADER) / STL_FACET)
        return formats_fail(in->error, in->path, "announces %lu triangles, but its %zu bytes hold only %zu",
                            (unsigned long)count, in->size, (in->size - STL_HEADER) / STL_FACET);
    for (n = 0; n < count; n++) {
        in->at = STL_HEADER + (size_t)STL_FACET * n;
        begin_polygon(b);
        for (k = 0; k < 3; k++) {
            double xyz[3];
            for (axis = 0; axis < 3; axis++) {
                uint32_t bits = little_endian32(in->data + in->at + 12 + 12 * k + 4 * axis);
                float single;
                memcpy(&single, &bits, sizeof single);
                xyz[axis] = (double)single;
            }
            if (!weld_corner(w, b, xyz)) return 0;
        }
        if (!end_polygon(b)) return 0;
    }
    return 1;
}

/* A binary file may begin with "solid" too: its size tells. */
static int stl_has_binary_size(const input *in) {
    return in->size >= STL_HEADER &&
           in->size == STL_HEADER + (size_t)STL_FACET * little_endian32(in->data + STL_HEADER - 4);
}

static int read_stl(builder *b) {
    weld w = {NULL, 0};
    int ok, is_text = take_word(b->in, "solid") && !stl_has_binary_size(b->in);
    b->in->at = 0;
    ok = is_text ? read_stl_ascii(b, &w) : read_stl_binary(b, &w);
    free(w.slots);
    return ok;
}

/* ---- any surface ---- */

static int begins_with_word(input *in, const char *word) {
    int found = take_word(in, word);
    in->at = 0;
    in->line = 1;
    return found;
}

/* The first word is a keyword that OBJ files begin with. */
static int begins_like_obj(input *in) {
    static const char *const words[] = {"v", "vn", "vt", "o", "g", "s", "mtllib", "usemtl"};
    size_t i;
    int found = 0;
    find_word(in);
    for (i = 0; i < sizeof words / sizeof words[0]; i++) found = found || take_word(in, words[i]);
    in->at = 0;
    in->line = 1;
    return found;
}

static int read_any(builder *b) {
    input *in = b->in;
    if (begins_with_word(in, "ply")) return read_ply(b);
    if (begins_with_word(in, "off") || begins_with_word(in, "coff") || begins_with_word(in, "noff")) return read_off(b);
    if (path_ends_with(in->path, ".obj")) return read_obj(b);
    if (path_ends_with(in->path, ".stl") || begins_with_word(in, "solid") || stl_has_binary_size(in))
        return read_stl(b);
    if (path_ends_with(in->path, ".off")) return read_off(b);
    if (begins_like_obj(in)) return read_obj(b);
    return formats_fail(in->error, in->path, "is none of OBJ, PLY, STL, OFF");
}

static int check_surface(const input *in, const formats_surface *surface) {
    int t, k;
    if (surface->triangle_count == 0) return formats_fail(in->error, in->path, "holds no triangles");
    for (t = 0; t < surface->triangle_count; t++)
        for (k = 0; k < 3; k++) {
            int vertex = surface->triangles[3 * (size_t)t + (size_t)k];
            if (vertex < 0 || vertex >= surface->vertex_count)
                return formats_fail(in->error, in->path, "triangle %d: no vertex %d (there are %d)", t, vertex,
                                    surface->vertex_count);
        }
    return 1;
}

int formats_read_surface(const char *path, formats_surface *out, formats_error *error) {
    input in;
    builder b;
    int ok;
    memset(out, 0, sizeof *out);
    memset(&b, 0, sizeof b);
    if (!input_open(&in, path, error)) return 0;
    b.in = &in;
    ok = read_any(&b) && check_surface(&in, &b.surface);
    free(in.data);
    if (ok) *out = b.surface;
    else formats_free_surface(&b.surface);
    return ok;
}

void formats_free_surface(formats_surface *surface) {
    free(surface->vertices);
    free(surface->triangles);
    memset(surface, 0, sizeof *surface);
}
