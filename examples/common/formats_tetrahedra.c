/* Readers of tetrahedral meshes: TetGen's .node and .ele, Gmsh's .msh. */
#include "formats_input.h"

/* A node as the file numbers it. */
typedef struct node_tag {
    long long tag;
    int vertex, line;
} node_tag;

typedef struct tetra_builder {
    input *in;
    formats_tetrahedra mesh;
    node_tag *tags; /* [vertex_count] by tag, once all nodes are there */
    int vertex_capacity, tag_capacity, tetrahedron_capacity;
} tetra_builder;

/* ---- nodes and tetrahedra ---- */

/* The coordinates follow where they are not known yet: the vertex is then at the origin. */
static int add_node(tetra_builder *b, long long tag) {
    formats_tetrahedra *mesh = &b->mesh;
    void *vertices = mesh->vertices, *tags = b->tags;
    int ok = input_room(b->in, &vertices, mesh->vertex_count, &b->vertex_capacity, 3 * sizeof(double));
    mesh->vertices = (double *)vertices;
    ok = ok && input_room(b->in, &tags, mesh->vertex_count, &b->tag_capacity, sizeof(node_tag));
    b->tags = (node_tag *)tags;
    if (!ok) return 0;
    memset(mesh->vertices + 3 * (size_t)mesh->vertex_count, 0, 3 * sizeof(double));
    b->tags[mesh->vertex_count].tag = tag;
    b->tags[mesh->vertex_count].vertex = mesh->vertex_count;
    b->tags[mesh->vertex_count].line = b->in->line;
    mesh->vertex_count++;
    return 1;
}

static int take_place(tetra_builder *b, int vertex) {
    double *x = b->mesh.vertices + 3 * (size_t)vertex;
    return take_number(b->in, &x[0]) && take_number(b->in, &x[1]) && take_number(b->in, &x[2]);
}

static int compare_tags(const void *left, const void *right) {
    const node_tag *a = (const node_tag *)left, *b = (const node_tag *)right;
    if (a->tag != b->tag) return a->tag < b->tag ? -1 : 1;
    return (a->vertex > b->vertex) - (a->vertex < b->vertex);
}

/* Sorts the tags; none may be there twice. */
static int end_nodes(tetra_builder *b) {
    int i;
    if (b->mesh.vertex_count) qsort(b->tags, (size_t)b->mesh.vertex_count, sizeof *b->tags, compare_tags);
    for (i = 1; i < b->mesh.vertex_count; i++)
        if (b->tags[i].tag == b->tags[i - 1].tag)
            return formats_fail(b->in->error, b->in->path, "line %d: node %lld is there already", b->tags[i].line,
                                b->tags[i].tag);
    return 1;
}

/* The vertex of a tag, or -1. */
static int find_node(const tetra_builder *b, long long tag) {
    int low = 0, high = b->mesh.vertex_count;
    while (low < high) {
        int middle = low + (high - low) / 2;
        if (b->tags[middle].tag < tag) low = middle + 1;
        else high = middle;
    }
    return low < b->mesh.vertex_count && b->tags[low].tag == tag ? b->tags[low].vertex : -1;
}

/* The number of a node: a whole word, so that 4.5 is none. */
static int take_tag(input *in, long long *out) {
    size_t start;
    skip_blanks(in);
    start = in->at;
    if (!take_integer(in, 0, LLONG_MAX, out)) return 0;
    if (in->at >= in->size || isspace(in->data[in->at]) || in->data[in->at] == '#') return 1;
    in->at = start;
    return fail_word(in, "is not a whole number");
}

/* Four tags on this line: the corners come first whatever the order of the element is. */
static int take_tetrahedron(tetra_builder *b, long long name) {
    formats_tetrahedra *mesh = &b->mesh;
    void *data = mesh->tetrahedra;
    int k, ok = input_room(b->in, &data, mesh->tetrahedron_count, &b->tetrahedron_capacity, 4 * sizeof(int));
    mesh->tetrahedra = (int *)data;
    for (k = 0; ok && k < 4; k++) {
        long long tag = 0;
        int vertex;
        if (!take_tag(b->in, &tag)) return 0;
        vertex = find_node(b, tag);
        if (vertex < 0) return fail_here(b->in, "tetrahedron %lld: there is no node %lld", name, tag);
        mesh->tetrahedra[4 * (size_t)mesh->tetrahedron_count + (size_t)k] = vertex;
    }
    mesh->tetrahedron_count += ok;
    return ok;
}

/* ---- TetGen ---- */

static int read_node_file(tetra_builder *b) {
    input *in = b->in;
    long long count, dimension, i, tag;
    if (!find_word(in)) return fail_here(in, "the counts are missing");
    if (!take_integer(in, 0, INT_MAX, &count) || !take_integer(in, 0, INT_MAX, &dimension)) return 0;
    if (dimension != 3) return fail_here(in, "nodes of dimension %lld, not 3", dimension);
    next_line(in);
    for (i = 0; i < count; i++, next_line(in)) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld nodes", i, count);
        if (!take_tag(in, &tag) || !add_node(b, tag)) return 0;
        if (!take_place(b, b->mesh.vertex_count - 1)) return 0; /* attributes and a boundary marker may follow */
    }
    return end_nodes(b);
}

static int read_ele_file(tetra_builder *b) {
    input *in = b->in;
    long long count, corners, i, name;
    if (!find_word(in)) return fail_here(in, "the counts are missing");
    if (!take_integer(in, 0, INT_MAX, &count) || !take_integer(in, 0, INT_MAX, &corners)) return 0;
    if (corners != 4 && corners != 10) return fail_here(in, "elements of %lld nodes, not 4 or 10", corners);
    next_line(in);
    for (i = 0; i < count; i++, next_line(in)) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld tetrahedra", i, count);
        if (!take_integer(in, 0, LLONG_MAX, &name) || !take_tetrahedron(b, name)) return 0;
    }
    return 1;
}

/* ---- Gmsh ---- */

/* What is said of elements of this type: 1 they are tetrahedra, 0 they have no volume, -1 anything else. */
static int msh_kind(long long type) {
    if (type == 4 || type == 11 || type == 29 || type == 30 || type == 31) return 1;
    if ((type >= 1 && type <= 3) || (type >= 8 && type <= 10) || type == 15 || type == 16) return 0;
    return type >= 20 && type <= 28 ? 0 : -1;
}

static int expect_section_end(input *in, const char *word, const char *shown) {
    if (find_word(in) && take_word(in, word)) return 1;
    return fail_here(in, "\"%s\" is missing", shown);
}

/* One line of elements, behind its number, with its type known. */
static int take_element(tetra_builder *b, long long type, long long name) {
    int kind = msh_kind(type);
    if (kind < 0) return fail_here(b->in, "element %lld of type %lld: of solids only tetrahedra are read", name, type);
    return kind == 0 || take_tetrahedron(b, name);
}

static int read_nodes_2(tetra_builder *b) {
    input *in = b->in;
    long long count, i, tag;
    if (!find_word(in)) return fail_here(in, "the number of nodes is missing");
    if (!take_integer(in, 0, INT_MAX, &count)) return 0;
    next_line(in);
    for (i = 0; i < count; i++, next_line(in)) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld nodes", i, count);
        if (!take_tag(in, &tag) || !add_node(b, tag)) return 0;
        if (!take_place(b, b->mesh.vertex_count - 1)) return 0;
    }
    return 1;
}

static int read_elements_2(tetra_builder *b) {
    input *in = b->in;
    long long count, i, k, name, type, tags, tag;
    if (!find_word(in)) return fail_here(in, "the number of elements is missing");
    if (!take_integer(in, 0, INT_MAX, &count)) return 0;
    next_line(in);
    for (i = 0; i < count; i++, next_line(in)) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld elements", i, count);
        if (!take_integer(in, 0, LLONG_MAX, &name) || !take_integer(in, 0, INT_MAX, &type)) return 0;
        if (!take_integer(in, 0, INT_MAX, &tags)) return 0;
        for (k = 0; k < tags; k++)
            if (!take_integer(in, LLONG_MIN, LLONG_MAX, &tag)) return 0;
        if (!take_element(b, type, name)) return 0;
    }
    return 1;
}

/* Blocks: first the tags of a block's nodes, then their places. */
static int read_nodes_4(tetra_builder *b) {
    input *in = b->in;
    long long blocks, total, block, dimension, entity, parametric, count, i, tag;
    if (!find_word(in)) return fail_here(in, "the numbers of blocks and nodes are missing");
    if (!take_integer(in, 0, INT_MAX, &blocks) || !take_integer(in, 0, INT_MAX, &total)) return 0;
    next_line(in);
    for (block = 0; block < blocks; block++) {
        int first = b->mesh.vertex_count;
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld blocks of nodes", block, blocks);
        if (!take_integer(in, 0, 3, &dimension) || !take_integer(in, LLONG_MIN, LLONG_MAX, &entity)) return 0;
        if (!take_integer(in, 0, 1, &parametric) || !take_integer(in, 0, INT_MAX, &count)) return 0;
        next_line(in);
        for (i = 0; i < count; i++, next_line(in)) {
            if (!find_word(in)) return fail_here(in, "ends after %lld of %lld nodes of a block", i, count);
            if (!take_tag(in, &tag) || !add_node(b, tag)) return 0;
        }
        for (i = 0; i < count; i++, next_line(in)) {
            if (!find_word(in)) return fail_here(in, "ends after %lld of %lld nodes of a block", i, count);
            if (!take_place(b, first + (int)i)) return 0;
        }
    }
    if (b->mesh.vertex_count != total)
        return fail_here(in, "the blocks hold %d nodes, announced were %lld", b->mesh.vertex_count, total);
    return 1;
}

static int read_elements_4(tetra_builder *b) {
    input *in = b->in;
    long long blocks, total, seen = 0, block, dimension, entity, type, count, i, name;
    if (!find_word(in)) return fail_here(in, "the numbers of blocks and elements are missing");
    if (!take_integer(in, 0, INT_MAX, &blocks) || !take_integer(in, 0, INT_MAX, &total)) return 0;
    next_line(in);
    for (block = 0; block < blocks; block++) {
        if (!find_word(in)) return fail_here(in, "ends after %lld of %lld blocks of elements", block, blocks);
        if (!take_integer(in, 0, 3, &dimension) || !take_integer(in, LLONG_MIN, LLONG_MAX, &entity)) return 0;
        if (!take_integer(in, 0, INT_MAX, &type) || !take_integer(in, 0, INT_MAX, &count)) return 0;
        next_line(in);
        for (i = 0; i < count; i++, next_line(in)) {
            if (!find_word(in)) return fail_here(in, "ends after %lld of %lld elements of a block", i, count);
            if (!take_integer(in, 0, LLONG_MAX, &name) || !take_element(b, type, name)) return 0;
        }
        seen += count;
    }
    if (seen != total) return fail_here(in, "the blocks hold %lld elements, announced were %lld", seen, total);
    return 1;
}

static int read_msh_format(input *in, int *version) {
    double number;
    long long is_binary;
    if (!find_word(in)) return fail_here(in, "the version is missing");
    if (!take_number(in, &number) || !take_integer(in, 0, 1, &is_binary)) return 0;
    if (is_binary) return fail_here(in, "binary MSH is not read: write it as ASCII");
    *version = number >= 2 && number < 2.3 ? 2 : number > 4.05 && number < 4.15 ? 4 : 0;
    if (!*version) return fail_here(in, "MSH of version %g is not read, but 2.2 and 4.1 are", number);
    next_line(in);
    return 1;
}

/* Sections that are not needed. The next line is behind the one that ends it. */
static int skip_section(input *in) {
    static const char ending[] = "$end";
    do {
        size_t i = 0;
        next_line(in);
        skip_blanks(in);
        while (i < 4 && tolower(in->data[in->at + i]) == ending[i]) i++;
        if (i == 4) return 1;
    } while (in->at < in->size);
    return fail_here(in, "ends within a section");
}

static int read_msh(tetra_builder *b) {
    input *in = b->in;
    int version = 0, nodes = 0, elements = 0, ok = 1;
    for (; ok && find_word(in); next_line(in)) {
        if (in->data[in->at] != '$') return fail_word(in, "stands where a section should begin");
        if (take_word(in, "$meshformat")) {
            ok = read_msh_format(in, &version) && expect_section_end(in, "$endmeshformat", "$EndMeshFormat");
        } else if (!version && !take_word(in, "$comments")) {
            return fail_here(in, "\"$MeshFormat\" is missing");
        } else if (take_word(in, "$nodes")) {
            if (nodes++) return fail_here(in, "nodes for a second time");
            next_line(in);
            ok = (version == 2 ? read_nodes_2(b) : read_nodes_4(b)) && end_nodes(b) &&
                 expect_section_end(in, "$endnodes", "$EndNodes");
        } else if (take_word(in, "$elements")) {
            if (elements++) return fail_here(in, "elements for a second time");
            if (!nodes) return fail_here(in, "elements before their nodes");
            next_line(in);
            ok = (version == 2 ? read_elements_2(b) : read_elements_4(b)) &&
                 expect_section_end(in, "$endelements", "$EndElements");
        } else {
            ok = skip_section(in);
        }
    }
    return ok;
}

/* ---- any of them ---- */

/* Six times the volume. */
static double signed_size(const double *a, const double *b, const double *c, const double *d) {
    double u[3], v[3], w[3];
    int k;
    for (k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = d[k] - a[k];
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0]);
}

/* Turns tetrahedra that are numbered the other way round, as TetGen's all are. */
static void orient(formats_tetrahedra *mesh) {
    int t;
    for (t = 0; t < mesh->tetrahedron_count; t++) {
        int *n = mesh->tetrahedra + 4 * (size_t)t, swap = n[2];
        const double *x = mesh->vertices;
        if (!(signed_size(x + 3 * (size_t)n[0], x + 3 * (size_t)n[1], x + 3 * (size_t)n[2], x + 3 * (size_t)n[3]) < 0))
            continue;
        n[2] = n[3];
        n[3] = swap;
    }
}

/* Leaves out vertices that no tetrahedron has. */
static int compact(tetra_builder *b) {
    formats_tetrahedra *mesh = &b->mesh;
    int *index, i, kept = 0;
    if (mesh->tetrahedron_count == 0) return formats_fail(b->in->error, b->in->path, "holds no tetrahedra");
    index = (int *)calloc((size_t)mesh->vertex_count, sizeof *index);
    if (!index) return fail_memory(b->in);
    for (i = 0; i / 4 < mesh->tetrahedron_count; i++) index[mesh->tetrahedra[i]] = 1;
    for (i = 0; i < mesh->vertex_count; i++) {
        if (!index[i]) continue;
        memmove(mesh->vertices + 3 * (size_t)kept, mesh->vertices + 3 * (size_t)i, 3 * sizeof(double));
        index[i] = kept++;
    }
    for (i = 0; i / 4 < mesh->tetrahedron_count; i++) mesh->tetrahedra[i] = index[mesh->tetrahedra[i]];
    mesh->vertex_count = kept;
    free(index);
    return 1;
}

/* The path with another ending, to be freed. */
static char *sibling(const char *path, const char *ending) {
    size_t stem = strrchr(path, '.') ? (size_t)(strrchr(path, '.') - path) : strlen(path);
    char *other = (char *)malloc(stem + strlen(ending) + 1);
    if (!other) return NULL;
    memcpy(other, path, stem);
    strcpy(other + stem, ending);
    return other;
}

static int read_file(tetra_builder *b, const char *path, int (*read)(tetra_builder *), formats_error *error) {
    input in;
    int ok;
    if (!path) return formats_fail(error, "tetrahedra", "out of memory");
    if (!input_open(&in, path, error)) return 0;
    b->in = &in;
    ok = read(b);
    free(in.data);
    return ok;
}

static int read_msh_file(tetra_builder *b) { return read_msh(b) && compact(b); }
static int read_ele_whole(tetra_builder *b) { return read_ele_file(b) && compact(b); }

int formats_read_tetrahedra(const char *path, formats_tetrahedra *out, formats_error *error) {
    tetra_builder b;
    int ok = 0;
    memset(out, 0, sizeof *out);
    memset(&b, 0, sizeof b);
    if (path_ends_with(path, ".msh")) {
        ok = read_file(&b, path, read_msh_file, error);
    } else if (path_ends_with(path, ".ele") || path_ends_with(path, ".node")) {
        char *nodes = sibling(path, ".node"), *elements = sibling(path, ".ele");
        int given = path_ends_with(path, ".ele");
        ok = read_file(&b, given ? nodes : path, read_node_file, error) &&
             read_file(&b, given ? path : elements, read_ele_whole, error);
        free(nodes);
        free(elements);
    } else {
        formats_fail(error, path, "is none of .ele, .node, .msh");
    }
    free(b.tags);
    if (ok) orient(&b.mesh);
    if (ok) *out = b.mesh;
    else formats_free_tetrahedra(&b.mesh);
    return ok;
}

void formats_free_tetrahedra(formats_tetrahedra *tetrahedra) {
    free(tetrahedra->vertices);
    free(tetrahedra->tetrahedra);
    memset(tetrahedra, 0, sizeof *tetrahedra);
}

dgfem_status formats_tetrahedra_mesh(const formats_tetrahedra *tetrahedra, const dgfem_hooks *hooks, dgfem_mesh **out) {
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    desc.vertices.data = tetrahedra->vertices;
    desc.vertices.type = DGFEM_FLOAT64;
    desc.vertices.count = tetrahedra->vertex_count;
    desc.tetrahedra = tetrahedra->tetrahedra;
    desc.tetrahedron_count = tetrahedra->tetrahedron_count;
    if (hooks) desc.hooks = *hooks;
    return dgfem_mesh_create_tetrahedra(&desc, out);
}
