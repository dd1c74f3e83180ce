OPENQASM 2.0;
include "qelib1.inc";
gate rcccx q0,q1,q2,q3 { h q3; t q3; cx q2,q3; tdg q3; h q3; cx q0,q3; t q3; cx q1,q3; tdg q3; cx q0,q3; t q3; cx q1,q3; tdg q3; h q3; t q3; cx q2,q3; tdg q3; h q3; }
gate xx_minus_yy(param0,param1) q0,q1 { rz(-param1) q1; sdg q0; sx q0; s q0; s q1; cx q0,q1; ry(0.5*param0) q0; ry((-0.5)*param0) q1; cx q0,q1; sdg q1; sdg q0; sxdg q0; s q0; rz(param1) q1; }
qreg q[4];
creg c[4];
x q[0];
u3(0.30635373165265484,6.278008685461637,4.098956016787445) q[3];
y q[2];
x q[1];
rcccx q[2],q[1],q[3],q[0];
x q[1];
xx_minus_yy(0.40347120902876316,4.267423429187548) q[3],q[2];
t q[0];
sdg q[1];
rccx q[2],q[3],q[0];
cu1(5.065600322332046) q[0],q[1];
cx q[3],q[2];
measure q[0] -> c[0];
measure q[1] -> c[1];
measure q[2] -> c[2];
measure q[3] -> c[3];
