# SPDX-License-Identifier: Apache-2.0
# `cmake --install build --prefix DIR` and, by CPack, a Debian package (`cpack -G DEB` in the build folder). Programs look
# for what comes with them in share/etude above themselves (services/core/share.h), so that any prefix works.
include(GNUInstallDirs)

set(ETUDE_SHARE ${CMAKE_INSTALL_DATADIR}/etude)
install(CODE "include([==[${CMAKE_SOURCE_DIR}/deploy/cmake/install_folders.cmake]==])
get_filename_component(prefix \"\${CMAKE_INSTALL_PREFIX}\" ABSOLUTE)
set(folders ${CMAKE_INSTALL_BINDIR} ${CMAKE_INSTALL_DATADIR} ${ETUDE_SHARE} ${ETUDE_SHARE}/systemd ${CMAKE_INSTALL_DATADIR}/doc
  ${CMAKE_INSTALL_DOCDIR} lib lib/sysusers.d lib/systemd lib/systemd/system)
list(TRANSFORM folders PREPEND \"\${prefix}/\")
etude_make_folders(\"\${prefix}\" \${folders})")

set(ETUDE_PROGRAMS etude etude-collector etude-worker etude-trainer etude-policy etude-gateway etude-object etude-plan)
install(TARGETS ${ETUDE_PROGRAMS} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})

# not USE_SOURCE_PERMISSIONS: files, too, may have been cloned under another umask than their readers need
install(DIRECTORY deploy/campaigns deploy/robots deploy/objects deploy/tasks deploy/dds deploy/up deploy/docs
        DESTINATION ${ETUDE_SHARE} PATTERN generate EXCLUDE)  # which needs the source tree
install(DIRECTORY trainer/experiments DESTINATION ${ETUDE_SHARE})
# the pages as they were built; `npm run build` in dashboard/web makes them again
install(DIRECTORY dashboard/web/dist/ DESTINATION ${ETUDE_SHARE}/web)
install(DIRECTORY deploy/kubernetes deploy/slurm deploy/container DESTINATION ${ETUDE_SHARE}
        PATTERN etude.sbatch EXCLUDE PATTERN build EXCLUDE)
install(PROGRAMS deploy/slurm/etude.sbatch DESTINATION ${ETUDE_SHARE}/slurm)
install(PROGRAMS deploy/container/build DESTINATION ${ETUDE_SHARE}/container)
# what the pages and the settings point to
install(DIRECTORY deploy/examples DESTINATION ${ETUDE_SHARE} PATTERN CMakeLists.txt EXCLUDE)
install(FILES deploy/systemd/README.md DESTINATION ${ETUDE_SHARE}/systemd)

# Units and their settings name absolute paths, which are known when it is installed and not before.
install(CODE "set(source [==[${CMAKE_SOURCE_DIR}/deploy]==])
set(made [==[${CMAKE_BINARY_DIR}/systemd]==])
get_filename_component(prefix \"\${CMAKE_INSTALL_PREFIX}\" ABSOLUTE)
set(bindir \"\${prefix}/${CMAKE_INSTALL_BINDIR}\")
set(share \"\${prefix}/${ETUDE_SHARE}\")
set(doc \"\${prefix}/${CMAKE_INSTALL_DOCDIR}\")
include([==[${CMAKE_SOURCE_DIR}/deploy/cmake/install_services.cmake]==])")
install(FILES deploy/systemd/sysusers.conf DESTINATION lib/sysusers.d RENAME etude.conf)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME copyright)
install(FILES README.md SECURITY.md DESTINATION ${CMAKE_INSTALL_DOCDIR})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME etude)
set(CPACK_PACKAGE_VENDOR "Etude")
set(CPACK_PACKAGE_CONTACT "Etude maintainers <etude@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "distributed demonstrations and training for language-conditioned robot policies")
set(CPACK_PACKAGE_DESCRIPTION "Workers plan demonstrations in MuJoCo and stream them over Cyclone DDS; a trainer learns a modular
policy while they arrive and publishes every checkpoint; a policy server drives the robot.")
# into a root of its own, for /usr: units and settings are then those of the system
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_THREADS 1)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
# the libraries that the programs are linked with; those that they open by name come below
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "libegl1, libgl1-mesa-dri, libosmesa6, libopenblas0-pthread, wordnet-base")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS systemd)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${CMAKE_SOURCE_DIR}/deploy/systemd/postinst ${CMAKE_SOURCE_DIR}/deploy/systemd/prerm
                                       ${CMAKE_SOURCE_DIR}/deploy/systemd/conffiles)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
include(CPack)
