#define WEFT_KERNEL kFindddAvx2
#include "descriptor/finddd_kernel.inc"
