#define WEFT_KERNEL kFindddBaseline
#include "descriptor/finddd_kernel.inc"
