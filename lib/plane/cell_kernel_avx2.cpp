#define WEFT_KERNEL kCellAvx2
#include "plane/cell_kernel.inc"
