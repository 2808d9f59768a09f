# SPDX-License-Identifier: Apache-2.0
# Run by `cmake --install`: writes units and settings for the prefix. Given: `source`, the folder deploy; `made`, a folder to
# write in; `prefix`, absolute; `bindir`, `share` and `doc`, where programs, what comes with them and pages to read go.
# Settings that are there already are kept.
if(prefix STREQUAL "/usr" OR prefix STREQUAL "/usr/local")
  set(settings /etc/etude)
else()
  set(settings ${prefix}/etc/etude)
endif()
file(GLOB templates ${source}/systemd/*.in)
foreach(template IN LISTS templates)
  get_filename_component(name ${template} NAME_WLE)
  configure_file(${template} ${made}/${name} @ONLY)
  if(name MATCHES "service$|target$")
    file(INSTALL ${made}/${name} DESTINATION ${prefix}/lib/systemd/system)
  endif()
endforeach()
foreach(file ${made}/etude.env ${source}/dds/local.xml)
  get_filename_component(name ${file} NAME)
  if(NOT EXISTS $ENV{DESTDIR}${settings}/${name})
    file(INSTALL ${file} DESTINATION ${settings})
  endif()
endforeach()
