# Builds a project that holds palpate as a subfolder.
include(${CMAKE_CURRENT_LIST_DIR}/try.cmake)
file(REMOVE_RECURSE ${SCRATCH})
try("configuring" ${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/subproject -B ${SCRATCH} -G ${GENERATOR}
    -DPALPATE=${ROOT} -DCMAKE_BUILD_TYPE=Debug)
try("building" ${CMAKE_COMMAND} --build ${SCRATCH} --target holder)
try("running" ${SCRATCH}/holder)
