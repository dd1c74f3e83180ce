OPENQASM 2.0;
include "qelib1.inc";
gate rzx(param0) q0,q1 { h q1; cx q0,q1; rz(param0) q1; cx q0,q1; h q1; }
gate ccz q0,q1,q2 { h q2; ccx q0,q1,q2; h q2; }
qreg q[4];
creg c[4];
rzx(0.7142223654075871) q[0],q[2];
tdg q[3];
c3sqrtx q[1],q[0],q[2],q[3];
c3sqrtx q[2],q[1],q[0],q[3];
ccz q[2],q[1],q[0];
cx q[1],q[0];
measure q[0] -> c[0];
measure q[1] -> c[1];
measure q[2] -> c[2];
measure q[3] -> c[3];
