/* Python builds and finds the kernels as an extension module, which is empty: they are called through ctypes. */
#include <Python.h>

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "library", "Compiled kernels, for ctypes.", -1};

PyMODINIT_FUNC PyInit_library(void) { return PyModule_Create(&module); }
