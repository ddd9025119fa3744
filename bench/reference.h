/* The tip of the hanging bar, in double and by the direct solver whatever the program's dgfem_real is. */
#ifndef REFERENCE_H
#define REFERENCE_H

/* Displacement of the end face after each of `steps` steps of 1/60 s. */
void reference_tip(const int *cells, int steps, double (*tip)[3]);

#endif
