# What `cmake --install` brings: the program with its scenes and documents (component "program"), and what other
# projects build against (component "development").
include(CMakePackageConfigHelpers)
set(PALPATE_SCENES_DIR ${CMAKE_INSTALL_DATADIR}/palpate/scenes)
set(PALPATE_DOCUMENTS ${CMAKE_INSTALL_DATADIR}/doc/palpate)
set(PALPATE_CMAKE ${CMAKE_INSTALL_LIBDIR}/cmake/palpate)

install(TARGETS palpate_c LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT program
        NAMELINK_COMPONENT development)
install(FILES scenes/api/palpate.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/palpate COMPONENT development)
install(DIRECTORY scenes/api/unity DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate COMPONENT development)
# Where Debian's python3 looks, if the prefix is /usr.
set(PALPATE_PYTHON_DIR lib/python3/dist-packages CACHE STRING "where the Python package is installed, in the prefix")
install(DIRECTORY scenes/api/python/palpate DESTINATION ${PALPATE_PYTHON_DIR} COMPONENT program
        PATTERN __pycache__ EXCLUDE)
install(TARGETS palpate palpate-tetgen RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
file(GLOB SCENE_FILES CONFIGURE_DEPENDS scenes/*.toml scenes/*.obj scenes/*.jsonl scenes/*.csv)
install(FILES ${SCENE_FILES} DESTINATION ${PALPATE_SCENES_DIR} COMPONENT program)
install(DIRECTORY meshes/fingers DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate COMPONENT program)
install(FILES LICENSE DESTINATION ${PALPATE_DOCUMENTS} RENAME copyright COMPONENT program)
install(FILES README.md DESTINATION ${PALPATE_DOCUMENTS} COMPONENT program)
foreach(room scenes scenes/api devices engine meshes bench tests)
    install(FILES ${room}/README.md DESTINATION ${PALPATE_DOCUMENTS}/${room} COMPONENT program)
endforeach()
install(DIRECTORY scenes/pictures DESTINATION ${PALPATE_DOCUMENTS}/scenes COMPONENT program)

install(TARGETS palpate_meshes palpate_devices palpate_drivers palpate_engine palpate_web palpate_trackers palpate_load palpate_run
        EXPORT palpate-targets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development
        INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT palpate-targets NAMESPACE palpate:: DESTINATION ${PALPATE_CMAKE} COMPONENT development)
configure_package_config_file(${PROJECT_SOURCE_DIR}/scenes/install/palpate-config.cmake.in ${PROJECT_BINARY_DIR}/palpate-config.cmake
                              INSTALL_DESTINATION ${PALPATE_CMAKE} PATH_VARS PALPATE_SCENES_DIR CMAKE_INSTALL_LIBDIR CMAKE_INSTALL_INCLUDEDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/palpate-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/palpate-config.cmake ${PROJECT_BINARY_DIR}/palpate-config-version.cmake
        DESTINATION ${PALPATE_CMAKE} COMPONENT development)
# The prefix may be another one at `cmake --install --prefix`: the file is made then.
install(CODE "set(PROJECT_DESCRIPTION \"${PROJECT_DESCRIPTION}\")
set(PROJECT_VERSION ${PROJECT_VERSION})
set(CMAKE_INSTALL_LIBDIR ${CMAKE_INSTALL_LIBDIR})
set(CMAKE_INSTALL_INCLUDEDIR ${CMAKE_INSTALL_INCLUDEDIR})
set(CMAKE_INSTALL_DATADIR ${CMAKE_INSTALL_DATADIR})
configure_file(${PROJECT_SOURCE_DIR}/scenes/install/palpate.pc.in ${PROJECT_BINARY_DIR}/palpate.pc @ONLY)"
        COMPONENT development)
install(FILES ${PROJECT_BINARY_DIR}/palpate.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)

# Headers that others may include; whatever these include comes along.
set(PALPATE_PUBLIC_HEADERS
    devices/device.h
    devices/drivers/board.h
    devices/drivers/simulated.h
    devices/loop/device_thread.h
    devices/loop/loop.h
    devices/matching/matching.h
    engine/build.h
    engine/step.h
    meshes/finger_presets.h
    meshes/finger_shape.h
    meshes/input_error.h
    meshes/mesh_files.h
    meshes/surface.h
    meshes/tetrahedralise.h
    scenes/load/find_scene.h
    scenes/load/finger_model.h
    scenes/load/scene.h
    scenes/load/section.h
    scenes/run/hardware.h
    scenes/run/simulation.h
    scenes/run/summary.h)
install(CODE "set(ROOT ${PROJECT_SOURCE_DIR})
set(STAGE ${PROJECT_BINARY_DIR}/public_headers)
set(PUBLIC_HEADERS \"${PALPATE_PUBLIC_HEADERS}\")
include(${PROJECT_SOURCE_DIR}/scenes/install/install_headers.cmake)" COMPONENT development)
install(DIRECTORY ${PROJECT_BINARY_DIR}/public_headers/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)
install(DIRECTORY tests/embed/example DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate COMPONENT development)

if(PROJECT_IS_TOP_LEVEL)
    set(CPACK_PACKAGE_CONTACT "palpate <palpate@localhost>")
    set(CPACK_PACKAGE_VENDOR "palpate")
    set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
    set(CPACK_STRIP_FILES ON)
    set(CPACK_COMPONENTS_ALL program development)
    set(CPACK_DEB_COMPONENT_INSTALL ON)
    set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
    set(CPACK_DEBIAN_PACKAGE_SECTION science)
    set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME palpate)
    set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
    set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "python3-numpy")  # for `import palpate`
    set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS "libopenxr-loader1")  # for hands from a headset
    set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME palpate-dev)
    set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
    set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "palpate (= ${PROJECT_VERSION}), libeigen3-dev, libtbb-dev, \
libopenmesh-dev, nlohmann-json3-dev, libtomlplusplus-dev, libnlopt-dev, libusb-1.0-0-dev")
    set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "The program, its scenes and its documentation.")
    set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "Libraries and headers: engine, devices, drivers, meshes, scene loader.")
    include(CPack)
endif()
