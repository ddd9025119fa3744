/* Tetrahedra for a closed surface, where no mesh generator is at hand. */
#ifndef LATTICE_H
#define LATTICE_H

#include "formats.h"

/* A body-centred cubic lattice of `cells` cubes along the longest extent, twelve tetrahedra a cube, is cut off at the
   surface: nodes near it move onto it, other edges get a node where they leave it (Labelle and Shewchuk 2007,
   isosurface stuffing, without its parity rule). Features thinner than a cube are lost, and of what is left the largest
   connected part is kept. 0 when out of memory or where nothing is inside. */
int lattice_fill(const formats_surface *surface, int cells, formats_tetrahedra *out);

#endif
