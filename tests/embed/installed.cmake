# Installs palpate into a scratch folder and, with nothing of the checkout in reach: builds the example project by
# find_package and with pkg-config, compiles every public header on its own, and runs a scene by its bare name from an
# empty folder.
include(${CMAKE_CURRENT_LIST_DIR}/try.cmake)
file(REMOVE_RECURSE ${SCRATCH})
set(prefix ${SCRATCH}/prefix)
try("installing" ${CMAKE_COMMAND} --install ${BUILD} --prefix ${prefix})
set(example ${prefix}/share/palpate/example)

try("configuring the example" ${CMAKE_COMMAND} -S ${example} -B ${SCRATCH}/example -G ${GENERATOR}
    -DCMAKE_PREFIX_PATH=${prefix})
try("building the example" ${CMAKE_COMMAND} --build ${SCRATCH}/example)
try("one step" ${SCRATCH}/example/consumer)
try("a preset finger in C" ${SCRATCH}/example/press)
try("a scene and a preset" ${SCRATCH}/example/scene ${prefix}/share/palpate/scenes/press.toml)

find_program(PKG_CONFIG pkg-config)
file(GLOB pc ${prefix}/lib*/pkgconfig/palpate.pc ${prefix}/lib/*/pkgconfig/palpate.pc)
if(PKG_CONFIG)
    cmake_path(GET pc PARENT_PATH folder)
    set(ENV{PKG_CONFIG_PATH} ${folder})
    try("pkg-config" ${PKG_CONFIG} --cflags --libs palpate)
    separate_arguments(flags UNIX_COMMAND "${output}")
    try("building with pkg-config" ${COMPILER} -std=c++20 ${example}/engine.cpp -o ${SCRATCH}/by-pkg-config ${flags})
    try("one step" ${SCRATCH}/by-pkg-config)
endif()

file(MAKE_DIRECTORY ${SCRATCH}/empty)
execute_process(COMMAND /usr/bin/python3 -c "import numpy" RESULT_VARIABLE lacks_numpy OUTPUT_QUIET ERROR_QUIET)
if(lacks_numpy EQUAL 0)
    set(ENV{PYTHONPATH} ${prefix}/lib/python3/dist-packages)
    try("the Python package" ${CMAKE_COMMAND} -E chdir ${SCRATCH}/empty /usr/bin/python3 -B -c
        "import palpate; world = palpate.load('press'); world.step(100); assert world.fingers[0].force[2] > 0.1")
endif()
try("running a scene by its bare name" ${CMAKE_COMMAND} -E chdir ${SCRATCH}/empty ${prefix}/bin/palpate run press
    --duration 0.05 --quiet)
if(NOT EXISTS ${SCRATCH}/empty/results/press/summary.json)
    message(FATAL_ERROR "palpate run press left no results")
endif()
