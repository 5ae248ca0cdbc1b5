#define WEFT_KERNEL kFpfhAvx2
#include "descriptor/fpfh_kernel.inc"
