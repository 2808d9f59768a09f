# SPDX-License-Identifier: Apache-2.0
# `cmake --install build --prefix DIR` and, by CPack, a Debian package (`cpack -G DEB` in the build folder). Programs look
# for what comes with them in share/etude above themselves (services/core/share.h), so that any prefix works; units, which
# name absolute paths, are written for CMAKE_INSTALL_PREFIX.
include(GNUInstallDirs)

set(ETUDE_PROGRAMS etude etude-collector etude-worker etude-trainer etude-policy etude-gateway etude-object etude-plan)
install(TARGETS ${ETUDE_PROGRAMS} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT etude)

set(ETUDE_SHARE ${CMAKE_INSTALL_DATADIR}/etude)
install(DIRECTORY deploy/campaigns deploy/robots deploy/objects deploy/tasks deploy/dds deploy/up deploy/docs
        DESTINATION ${ETUDE_SHARE} COMPONENT etude USE_SOURCE_PERMISSIONS)
install(DIRECTORY trainer/experiments DESTINATION ${ETUDE_SHARE} COMPONENT etude)
# the pages as they were built; `npm run build` in dashboard/web makes them again
install(DIRECTORY dashboard/web/dist/ DESTINATION ${ETUDE_SHARE}/web COMPONENT etude)
install(DIRECTORY deploy/kubernetes deploy/slurm deploy/container
        DESTINATION ${ETUDE_SHARE} COMPONENT etude USE_SOURCE_PERMISSIONS)

# Units and their settings. With a prefix of the system's they go where systemd looks; else below the prefix.
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr" OR CMAKE_INSTALL_PREFIX STREQUAL "/usr/local")
  set(ETUDE_SETTINGS /etc/etude)
else()
  set(ETUDE_SETTINGS ${CMAKE_INSTALL_PREFIX}/etc/etude)
endif()
set(ETUDE_SHARE_FULL ${CMAKE_INSTALL_FULL_DATADIR}/etude)
set(ETUDE_BINDIR ${CMAKE_INSTALL_FULL_BINDIR})
set(ETUDE_UNITS etude-collector.service etude-worker@.service etude-trainer.service etude-policy.service
                etude-gateway.service etude.target)
foreach(unit IN LISTS ETUDE_UNITS)
  configure_file(deploy/systemd/${unit}.in ${CMAKE_BINARY_DIR}/systemd/${unit} @ONLY)
  install(FILES ${CMAKE_BINARY_DIR}/systemd/${unit} DESTINATION lib/systemd/system COMPONENT etude)
endforeach()
configure_file(deploy/systemd/etude.env.in ${CMAKE_BINARY_DIR}/systemd/etude.env @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/systemd/etude.env deploy/dds/local.xml DESTINATION ${ETUDE_SETTINGS} COMPONENT etude)
install(FILES deploy/systemd/sysusers.conf DESTINATION lib/sysusers.d RENAME etude.conf COMPONENT etude)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME copyright COMPONENT etude)
install(FILES README.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT etude)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME etude)
set(CPACK_PACKAGE_VENDOR "Etude")
set(CPACK_PACKAGE_CONTACT "Etude maintainers <etude@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "distributed demonstrations and training for language-conditioned robot policies")
set(CPACK_PACKAGE_DESCRIPTION "Workers plan demonstrations in MuJoCo and stream them over Cyclone DDS; a trainer learns a modular
policy while they arrive and publishes every checkpoint; a policy server drives the robot.")
set(CPACK_PACKAGING_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_STRIP_FILES ON)
set(CPACK_THREADS 1)
set(CPACK_COMPONENTS_ALL etude)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
# the libraries that the programs are linked with; those that they open by name come below
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "libegl1, libgl1-mesa-dri, libosmesa6, libopenblas0-pthread, wordnet-base")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "systemd, h5utils")
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${CMAKE_SOURCE_DIR}/deploy/systemd/postinst ${CMAKE_SOURCE_DIR}/deploy/systemd/prerm
                                       ${CMAKE_SOURCE_DIR}/deploy/systemd/conffiles)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
include(CPack)
