#define WEFT_KERNEL kHksAvx2
#include "descriptor/hks_kernel.inc"
