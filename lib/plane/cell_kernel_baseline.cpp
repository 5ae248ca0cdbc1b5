#define WEFT_KERNEL kCellBaseline
#include "plane/cell_kernel.inc"
