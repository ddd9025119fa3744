/* Patterns of matrices with three unknowns for each node, as dgfem_shell.h and dgfem_mvc.h make them: which nodes are
   coupled, and where they are. All values are zero. */
#ifndef NODES_H
#define NODES_H

#include "bench.h"
#include "formats.h"

/* Couplings still to be made a matrix of. */
typedef struct nodes {
    dgfem_vec3 *places;
    int *pairs;
    int count, pair_count, room;
} nodes;

static inline int nodes_add(nodes *n, double x, double y, double z) {
    dgfem_vec3 *place = &n->places[n->count];
    place->x = (dgfem_real)x, place->y = (dgfem_real)y, place->z = (dgfem_real)z;
    return n->count++;
}

/* Couples every node of a list with all of them. */
static inline void nodes_couple(nodes *n, const int *list, int count) {
    if (n->room - n->pair_count < count * count) {
        n->room = 2 * n->room + count * count;
        n->pairs = (int *)realloc(n->pairs, 2 * (size_t)n->room * sizeof(int));
        expect(n->pairs != NULL, "malloc");
    }
    for (int a = 0; a < count; a++)
        for (int b = 0; b <= a; b++, n->pair_count++)
            n->pairs[2 * n->pair_count] = list[a], n->pairs[2 * n->pair_count + 1] = list[b];
}

static inline dgfem_matrix *nodes_matrix(nodes *n) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix = NULL;
    int *sizes = (int *)room((size_t)n->count, sizeof(int));
    for (int i = 0; i < n->count; i++) sizes[i] = 3;
    desc.block_count = n->count;
    desc.block_sizes = sizes;
    desc.pairs = n->pairs;
    desc.pair_count = n->pair_count;
    desc.centres = n->places;
    expect(dgfem_matrix_create(&desc, &matrix) == DGFEM_OK, "dgfem_matrix_create");
    free(sizes);
    free(n->pairs);
    free(n->places);
    return matrix;
}

/* ---- a shell ---- */

/* Quadrilaterals of eight nodes on a tube; all nodes of an element are coupled, and all of two elements that share an
   edge. */
static inline dgfem_matrix *nodes_shell(int around, int along) {
    const double pi = 3.14159265358979323846;
    static const int offsets[8][2] = {{0, 0}, {1, 0}, {2, 0}, {0, 1}, {2, 1}, {0, 2}, {1, 2}, {2, 2}};
    int wide = 2 * around, high = 2 * along + 1;
    int *number = (int *)room((size_t)(wide * high), sizeof(int));
    nodes n;
    memset(&n, 0, sizeof n);
    n.places = (dgfem_vec3 *)room((size_t)(wide * high), sizeof *n.places);
    for (int j = 0; j < high; j++)
        for (int i = 0; i < wide; i++)
            if (i % 2 == 0 || j % 2 == 0) { /* none in the middle of an element */
                double angle = 2 * pi * i / wide;
                number[j * wide + i] = nodes_add(&n, cos(angle), sin(angle), 2.0 * j / (high - 1));
            }
    for (int j = 0; j < along; j++)
        for (int i = 0; i < around; i++)
            for (int edge = 0; edge < 2; edge++) { /* with the next element around; along */
                int list[16], count = 0;
                for (int side = 0; side < (edge && j + 1 == along ? 1 : 2); side++)
                    for (int k = 0; k < 8; k++) {
                        int x = 2 * (edge ? i : i + side) + offsets[k][0];
                        int y = 2 * (edge ? j + side : j) + offsets[k][1];
                        list[count++] = number[y * wide + x % wide];
                    }
                nodes_couple(&n, list, count);
            }
    free(number);
    return nodes_matrix(&n);
}

/* ---- conforming solids: all nodes of an element are coupled ---- */

static inline dgfem_matrix *nodes_hexahedra(int cells) {
    int wide = cells + 1;
    nodes n;
    memset(&n, 0, sizeof n);
    n.places = (dgfem_vec3 *)room((size_t)(wide * wide * wide), sizeof *n.places);
    for (int i = 0; i < wide * wide * wide; i++) (void)nodes_add(&n, i % wide, i / wide % wide, i / (wide * wide));
    for (int i = 0; i < wide * wide * wide; i++) {
        int list[8];
        if (i % wide == cells || i / wide % wide == cells || i / (wide * wide) == cells) continue;
        for (int k = 0; k < 8; k++) list[k] = i + k % 2 + k / 2 % 2 * wide + k / 4 * wide * wide;
        nodes_couple(&n, list, 8);
    }
    return nodes_matrix(&n);
}

static inline dgfem_matrix *nodes_tetrahedra(const formats_tetrahedra *mesh) {
    nodes n;
    memset(&n, 0, sizeof n);
    n.places = (dgfem_vec3 *)room((size_t)mesh->vertex_count, sizeof *n.places);
    for (int i = 0; i < mesh->vertex_count; i++)
        (void)nodes_add(&n, mesh->vertices[3 * i], mesh->vertices[3 * i + 1], mesh->vertices[3 * i + 2]);
    for (int e = 0; e < mesh->tetrahedron_count; e++) nodes_couple(&n, mesh->tetrahedra + 4 * e, 4);
    return nodes_matrix(&n);
}

#endif
